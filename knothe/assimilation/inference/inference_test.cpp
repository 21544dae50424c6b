#include "knothe/assimilation/inference/inference.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "knothe/assimilation/inference/comparison.hpp"
#include "knothe/base/error.hpp"
#include "knothe/model/forward/umbridge_protocol.hpp"
#include "knothe/model/testing/forward_models.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/draws/bridge_sampling.hpp"
#include "knothe/posterior/quadrature/tensor_quadrature.hpp"
#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::assimilation {
namespace {

using posterior::Prior;
using posterior::QuadraturePosterior;

/// As `Method::grid` does it.
QuadraturePosterior along_modes(posterior::LogDensity& target) {
  static constexpr Eigen::Index k_nodes[] = {257, 65, 25, 0};
  return posterior::tensor_quadrature(target, {.axes = posterior::QuadratureOptions::Axes::modes,
                                               .coarse_nodes = k_nodes[target.dimension() - 1],
                                               .max_nodes = 150'000});
}

namespace targets = posterior::targets;

TEST(GridQuadrature, NarrowRotatedGaussianInThreeDimensions) {
  const Eigen::Matrix3d precision = (Eigen::Matrix3d() << 900, 850, 0, 850, 900, 30, 0, 30, 50).finished();
  targets::Gaussian gaussian(Eigen::Vector3d(0.4, -1, 2), precision, 1.25);
  const QuadraturePosterior grid = along_modes(gaussian);
  EXPECT_TRUE(grid.resolved());
  EXPECT_NEAR(grid.log_evidence, 1.25, 1e-6);
  const numerics::Moments summary = numerics::moments_of(grid.points(), grid.weights);
  EXPECT_LT((summary.mean - gaussian.mean).norm(), 1e-7);
  EXPECT_LT((summary.covariance - precision.inverse()).norm(), 1e-7);
  EXPECT_LT(grid.evaluations, 60'000);
  for (Eigen::Index k = 0; k < 3; ++k) {
    EXPECT_NEAR(summary.skewness[k], 0, 1e-6);
    EXPECT_NEAR(summary.kurtosis[k], 3, 1e-5);
  }
}

TEST(GridQuadrature, QuantilesOfIndependentParametersAreNotNodesOfTheLattice) {
  targets::Gaussian gaussian(Eigen::Vector3d(1, -2, 0), Eigen::Vector3d(4, 1, 100).asDiagonal());
  const QuadraturePosterior grid = along_modes(gaussian);
  const Eigen::MatrixXd quantiles = numerics::weighted_quantiles(grid.points(), grid.weights);
  const std::array<double, 5> exact = {-1.959963985, -0.6744897502, 0, 0.6744897502, 1.959963985};
  for (Eigen::Index k = 0; k < 3; ++k)
    for (std::size_t l = 0; l < exact.size(); ++l)
      EXPECT_NEAR((quantiles(k, static_cast<Eigen::Index>(l)) - gaussian.mean[k]) *
                      std::sqrt(gaussian.precision(k, k)),
                  exact[l], 0.02)
          << "parameter " << k << ", level " << l;
  for (Eigen::Index k = 0; k < 3; ++k)
    for (std::size_t l = 0; l < exact.size(); ++l)
      EXPECT_NEAR((grid.quantiles(k, static_cast<Eigen::Index>(l)) - gaussian.mean[k]) *
                      std::sqrt(gaussian.precision(k, k)),
                  exact[l], 1e-3);
}

TEST(GridQuadrature, BananaAndTwoModes) {
  targets::Planar banana(targets::banana(1, 0, 0.5));
  const QuadraturePosterior grid = along_modes(banana);
  EXPECT_TRUE(grid.resolved());
  EXPECT_NEAR(grid.log_evidence, 0, 1e-3);
  const numerics::Moments summary = numerics::moments_of(grid.points(), grid.weights);
  EXPECT_NEAR(summary.mean[1], 1, 2e-3);                  // E x²
  EXPECT_NEAR(summary.covariance(1, 1), 2 + 0.25, 1e-2);  // Var x² + s²
  targets::Planar mixture(targets::mixture(4, 0.3));
  const QuadraturePosterior two = along_modes(mixture);
  EXPECT_TRUE(two.resolved());
  EXPECT_NEAR(two.log_evidence, 0, 1e-3);
  EXPECT_NEAR(numerics::moments_of(two.points(), two.weights).mean[0], -0.3 * 4 + 0.7 * 4, 1e-2);
}

TEST(GridQuadrature, RefusesFourDimensions) {
  targets::Gaussian gaussian(Eigen::VectorXd::Zero(4), Eigen::MatrixXd::Identity(4, 4));
  EXPECT_THROW((void)along_modes(gaussian), UsageError);
}

TEST(BridgeSampling, FindsTheEvidenceOfABanana) {
  targets::Planar banana(targets::banana(0.5, 0, 1));
  // Independent draws of the banana itself.
  Eigen::MatrixXd draws = numerics::sobol_normal_points(4096, 2, 5);
  draws.col(1) += 0.5 * draws.col(0).cwiseAbs2();
  // In no order: every other point of a Sobol sequence lies in one half of the plane.
  draws = numerics::resample(draws, Eigen::VectorXd::Constant(4096, 1.0 / 4096), 4096, 11);
  const posterior::BridgeEstimate estimate = posterior::bridge_sampling(banana, draws, 4096, 1024, 7);
  EXPECT_NEAR(estimate.log_evidence, 0, 0.05);
  EXPECT_GT(estimate.error, 0);
  EXPECT_LT(estimate.error, 0.1);
  EXPECT_LT(std::abs(estimate.log_evidence), 4 * estimate.error);
}

TEST(Summary, MomentsOfAnExponentialVariable) {
  const Eigen::Index n = 20000;
  Eigen::MatrixXd points(n, 1);
  Eigen::VectorXd weights(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    points(i, 0) = 40 * (static_cast<double>(i) + 0.5) / static_cast<double>(n);
    weights[i] = std::exp(-points(i, 0));
  }
  weights /= weights.sum();
  const numerics::Moments s = numerics::moments_of(points, weights);
  EXPECT_NEAR(s.mean[0], 1, 1e-5);
  EXPECT_NEAR(s.covariance(0, 0), 1, 1e-5);
  EXPECT_NEAR(s.skewness[0], 2, 1e-4);
  EXPECT_NEAR(s.kurtosis[0], 9, 1e-3);
  EXPECT_NEAR(numerics::weighted_quantiles(points, weights)(0, 2), std::log(2), 1e-3);
  const Eigen::MatrixXd draws = numerics::resample(points, weights, 5000, 3);
  EXPECT_NEAR(draws.mean(), 1, 0.01);
  EXPECT_NEAR(draws.topRows(1000).mean(), 1, 0.15);  // any part is a sample
}

TEST(Protocol, TheServersWordsReachTheUser) {
  const auto message = [](const model::HttpAnswer& answer) -> std::string {
    try {
      (void)model::umbridge::read_answer(answer, "W");
    } catch (const DataError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(message({200, R"({"error":{"type":"T","message":"M"}})"}), "W: the server says: T: M");
  EXPECT_EQ(message({500, "boom"}), "W: the server answered with HTTP status 500: boom");
  EXPECT_EQ(message({200, "{\"output\": [[nan]] }"}),
            "W: the answer is not JSON (which has no NaN and no infinity): {\"output\": [[nan]] }");
  EXPECT_EQ(message({200, "[1]"}), "W: the answer is not a JSON object: [1]");
  EXPECT_EQ(model::umbridge::read_answer({200, R"({"output":[[-Infinity]],"s":"-inf"})"}, "W", true)["s"],
            "-inf");
  EXPECT_LT(
      model::umbridge::read_answer({200, "{\"output\":[[-inf]]}"}, "W", true)["output"][0][0].get<double>(),
      -1e308);
}

TEST(Address, IsReadAndChecked) {
  const model::HttpAddress a = model::HttpAddress::parse("http://[::1]:80/base/");
  EXPECT_EQ(a.host, "::1");
  EXPECT_EQ(a.port, "80");
  EXPECT_EQ(a.base, "/base");
  for (const char* wrong : {"ftp://x", "http://", "http://x:0", "http://x:70000", "http://x:y", "https://x"})
    EXPECT_THROW((void)model::HttpAddress::parse(wrong), UsageError) << wrong;
}

/// One run of each method on the same posterior; grid is the judge.
TEST(Inference, AllMethodsAgree) {
  const std::vector<Prior> priors = {Prior::lognormal(0.1, 0.4), Prior::uniform(-1.0, 2.0)};
  const Observations observations{Eigen::Vector3d(1.4, 0.9, 0.2),
                                  likelihood::GaussianNoise::independent(Eigen::Vector3d(0.3, 0.3, 0.2))};
  InferenceOptions options;
  options.samples = 4000;
  const auto run = [&](posterior::Method method) {
    model::test_models::Smooth model;
    model.jacobian_too = model.hessian_too = true;
    ModelEvaluator evaluator(model, priors, 1e-4);
    PosteriorDensity posterior(evaluator, priors, observations);
    options.method = method;
    return infer(posterior, evaluator, options);
  };
  const InferenceResult judge = run(posterior::Method::grid);
  EXPECT_TRUE(judge.trusted) << judge.verdict;
  model::test_models::Smooth truth;
  Eigen::MatrixXd best(3, 1);
  truth.evaluate(judge.maximum_a_posteriori, best);
  EXPECT_EQ(judge.predicted, best.col(0));
  EXPECT_EQ(observations.noise.measurement_std(), Eigen::Vector3d(0.3, 0.3, 0.2));
  for (const posterior::Method method : {posterior::Method::transport, posterior::Method::markov_chain,
                                         posterior::Method::sequential_monte_carlo}) {
    const InferenceResult result = run(method);
    const Comparison c = compare(judge, result);
    const double tolerance = method == posterior::Method::transport ? 0.02 : 0.12;
    EXPECT_TRUE(result.trusted) << result.verdict;
    EXPECT_LT(c.mean_difference.cwiseAbs().maxCoeff(), tolerance) << to_text(method);
    EXPECT_LT((c.std_ratio.array() - 1).abs().maxCoeff(), tolerance) << to_text(method);
    EXPECT_LT(std::abs(c.log_evidence_difference), method == posterior::Method::transport ? 0.01 : 0.25)
        << to_text(method);
    EXPECT_LT((result.maximum_a_posteriori - judge.maximum_a_posteriori).norm(), 1e-5) << to_text(method);
  }
}

/// Calls take a second each on a clock of their own.
struct Slow : model::test_models::Smooth {
  double time = 0;
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points,
                Eigen::Ref<Eigen::MatrixXd> values) override {
    Smooth::evaluate(points, values);
    time += points.cols();
    for (Eigen::Index i = 0; answered && i < points.cols(); ++i) answered(i);
  }
};

/// An inference of `Slow` that can be gone on with.
struct SlowRun {
  std::vector<ModelCall> answers;
  Eigen::Index calls = 0;

  InferenceResult run(posterior::Method method, double seconds) {
    const std::vector<Prior> priors = {Prior::lognormal(0.1, 0.4), Prior::uniform(-1.0, 2.0)};
    Slow model;
    ModelEvaluator evaluator(model, priors, 1e-4);
    evaluator.clock = [&] { return model.time; };
    for (const ModelCall& answer : answers) evaluator.remember(answer);
    evaluator.answered = [&](const ModelCall& call) { answers.push_back(call); };
    PosteriorDensity posterior(
        evaluator, priors,
        Observations{Eigen::Vector3d(1.4, 0.9, 0.2),
                     likelihood::GaussianNoise::independent(Eigen::Vector3d(0.3, 0.3, 0.2))},
        useful_derivatives(method, false));
    InferenceOptions options;
    options.method = method;
    options.samples = 4000;
    options.seconds = seconds;
    const auto count = [&] { calls = model.calls().evaluations; };
    try {
      InferenceResult result = infer(posterior, evaluator, options);
      count();
      return result;
    } catch (const NumericalError&) {
      count();
      throw;
    }
  }
};

TEST(Inference, EveryMethodEndsInTimeWithAnAnswerAndItsError) {
  const InferenceResult judge = SlowRun().run(posterior::Method::grid, 0);
  for (const posterior::Method method :
       {posterior::Method::transport, posterior::Method::grid, posterior::Method::markov_chain,
        posterior::Method::sequential_monte_carlo})
    for (const double seconds : {900.0, 2500.0}) {
      SlowRun slow;
      const InferenceResult result = slow.run(method, seconds);
      EXPECT_LE(slow.calls, seconds) << to_text(method);
      const Comparison c = compare(judge, result);
      EXPECT_LT(c.mean_difference.cwiseAbs().maxCoeff(), result.mean_error) << result.verdict;
      EXPECT_LT(c.std_ratio.array().log().abs().maxCoeff(), result.deviation_error) << result.verdict;
    }
}

TEST(Inference, WhatTheClockEndedGoesOnWhereItWas) {
  const posterior::Method method = posterior::Method::sequential_monte_carlo;
  SlowRun whole, slow;
  const InferenceResult at_once = whole.run(method, 0), ended = slow.run(method, 1500);
  EXPECT_FALSE(ended.trusted);
  EXPECT_TRUE(ended.budget_spent);
  EXPECT_NE(ended.verdict.find(" The time of 1500 s is over: seconds = 3000 goes on from here."),
            std::string::npos)
      << ended.verdict;
  const Eigen::Index calls = slow.calls;
  const InferenceResult gone_on = slow.run(method, 0);
  EXPECT_EQ(gone_on.mean, at_once.mean);
  EXPECT_EQ(gone_on.covariance, at_once.covariance);
  // What it tried after its end, the most probable point from elsewhere, is not asked for again.
  EXPECT_LE(calls + slow.calls, whole.calls + 100);
  EXPECT_GE(calls + slow.calls, whole.calls);
}

TEST(Inference, AnAnswerTakesMoreThanAFewCalls) {
  const auto message = [](double seconds) -> std::string {
    try {
      (void)SlowRun().run(posterior::Method::sequential_monte_carlo, seconds);
    } catch (const NumericalError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(message(10), "the time for calls of the model is over: raise seconds");
  EXPECT_EQ(message(100), "");
}

}  // namespace
}  // namespace knothe::assimilation
