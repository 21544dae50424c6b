/// Densities that users bring: not smooth, bounded, heavy-tailed, bent; each with its answer in closed form.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "knothe/assimilation/inference/comparison.hpp"
#include "knothe/assimilation/inference/inference.hpp"
#include "knothe/base/error.hpp"
#include "knothe/model/testing/forward_models.hpp"

namespace knothe::assimilation {
namespace {

using posterior::Method;
using posterior::Prior;
using Vector = Eigen::VectorXd;

constexpr double k_outside = -std::numeric_limits<double>::max();  // as a server says that there is none

/// A density that complains of points that are not finite.
struct Density {
  const char* name;
  std::function<double(const Vector&)> log;
  std::vector<Prior> region;
  Vector mean, std;
};

InferenceResult answer_of(const Density& density, Method method, InferenceOptions options = {}) {
  model::test_models::Scalar model(std::ssize(density.region), [&](const Vector& p) {
    if (!p.allFinite()) throw DataError("asked at a point that is not finite");
    return std::max(density.log(p),
                    std::numeric_limits<double>::lowest());  // as the front ends have it of −∞
  });
  ModelEvaluator evaluator(model, density.region, 1e-4);
  PosteriorDensity posterior(evaluator, density.region, {}, useful_derivatives(method, false));
  options.method = method;
  return infer(posterior, evaluator, options);
}

void expect_right(const Density& density, const InferenceResult& r) {
  const Vector mean = (r.mean - density.mean).cwiseQuotient(density.std).cwiseAbs();
  const Vector deviation = (r.standard_deviations().cwiseQuotient(density.std).array() - 1).abs().matrix();
  EXPECT_LE(mean.maxCoeff(), r.mean_error) << density.name << " " << to_text(r.method);
  EXPECT_LE(deviation.maxCoeff(), r.deviation_error) << density.name << " " << to_text(r.method);
}

std::vector<Prior> normals(Eigen::Index d, double std) {
  return std::vector<Prior>(d, Prior::normal(0.0, std));
}

Density laplace() {
  return {"Laplace", [](const Vector& p) { return -std::abs(p[0] - 1.7); }, normals(1, 1),
          Vector::Constant(1, 1.7), Vector::Constant(1, std::numbers::sqrt2)};
}

Density exponential() {
  return {"exponential", [](const Vector& p) { return p[0] < 0 ? k_outside : -p[0]; }, normals(1, 2),
          Vector::Ones(1), Vector::Ones(1)};
}

Density half_normal() {
  return {"half normal", [](const Vector& p) { return p[0] < 0 ? k_outside : -0.5 * p[0] * p[0]; },
          normals(1, 2), Vector::Constant(1, std::sqrt(2 / std::numbers::pi)),
          Vector::Constant(1, std::sqrt(1 - 2 / std::numbers::pi))};
}

Density disc() {
  return {"disc", [](const Vector& p) { return p.squaredNorm() < 1 ? 0.0 : k_outside; }, normals(2, 1),
          Vector::Zero(2), Vector::Constant(2, 0.5)};
}

Density banana(double x_std, double y_std) {
  return {
      "banana",
      [](const Vector& p) { return -(100 * std::pow(p[1] - p[0] * p[0], 2) + std::pow(1 - p[0], 2)) / 20; },
      {Prior::normal(0.0, x_std), Prior::normal(0.0, y_std)},
      Eigen::Vector2d(1, 11),
      Eigen::Vector2d(std::sqrt(10.0), std::sqrt(0.1 + 40 + 200))};
}

/// Student's t: (1 + x²/ν)^(−(ν+1)/2).
Density student(double nu) {
  return {"Student's t", [nu](const Vector& p) { return -0.5 * (nu + 1) * std::log1p(p[0] * p[0] / nu); },
          normals(1, 3), Vector::Zero(1), Vector::Constant(1, std::sqrt(nu / (nu - 2)))};
}

/// Of draws from the region one in a thousand has any density: nothing can be fitted to so few.
Density half_normal_beside() {
  Density density = half_normal();
  density.region = {Prior::normal(-3.0, 1.0)};
  return density;
}

/// [0, 1]⁶ in a region of thrice its width: one draw in 729.
Density cube() {
  return {"cube", [](const Vector& p) { return p.minCoeff() > 0 && p.maxCoeff() < 1 ? 0.0 : k_outside; },
          std::vector<Prior>(6, Prior::uniform(-1.0, 2.0)), Vector::Constant(6, 0.5),
          Vector::Constant(6, std::sqrt(1 / 12.0))};
}

TEST(Densities, KinksAndBoundsAreAnsweredByDraws) {
  for (const Density& density :
       {laplace(), exponential(), half_normal(), half_normal_beside(), cube(), disc()}) {
    const InferenceResult r = answer_of(density, Method::automatic);
    EXPECT_TRUE(r.trusted) << density.name << ": " << r.verdict;
    expect_right(density, r);
    EXPECT_LE(r.calls.evaluations, 20000);
    EXPECT_TRUE(r.skewness.allFinite() && r.kurtosis.allFinite());
  }
}

TEST(Densities, TheMostProbablePointIsAtTheKinkOrTheBound) {
  EXPECT_NEAR(answer_of(laplace(), Method::automatic).maximum_a_posteriori[0], 1.7, 1e-3);
  EXPECT_NEAR(answer_of(exponential(), Method::automatic).maximum_a_posteriori[0], 0, 2e-3);
  EXPECT_NEAR(answer_of(half_normal(), Method::automatic).maximum_a_posteriori[0], 0, 2e-3);
}

TEST(Densities, EveryMethodEndsWithinItsBudgetWithAnAnswer) {
  for (const Density& density : {laplace(), exponential(), disc(), banana(5, 20)})
    for (const Method method :
         {Method::transport, Method::grid, Method::markov_chain, Method::sequential_monte_carlo}) {
      InferenceOptions options;
      options.evaluations = 6000;
      const InferenceResult r = answer_of(density, method, options);
      EXPECT_LE(r.calls.evaluations, 6000) << density.name << " " << to_text(method);
      EXPECT_TRUE(r.mean.allFinite() && r.covariance.allFinite()) << density.name << " " << to_text(method);
      if (r.trusted) expect_right(density, r);
      if (r.budget_spent) {
        EXPECT_NE(r.verdict.find("The budget of 6000 calls is spent: evaluations = 12000 goes on"),
                  std::string::npos)
            << r.verdict;
      }
    }
}

TEST(Densities, AMapOfAKinkEndsWithinItsBudget) {
  for (const Density& density : {laplace(), exponential(), disc()}) {
    InferenceOptions options;
    options.evaluations = 20000;
    const InferenceResult r = answer_of(density, Method::transport, options);
    EXPECT_LE(r.calls.evaluations, 20000) << density.name;
    if (r.trusted) expect_right(density, r);
  }
}

/// Trusted means right: the ends of a narrow ridge, wherever the region stated ends.
TEST(Densities, ABananaThatIsTrustedIsRight) {
  int trusted = 0;
  for (const auto& [x_std, y_std] : {std::pair{5.0, 20.0}, std::pair{1.5, 1.5}, std::pair{20.0, 80.0}})
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      InferenceOptions options;
      options.seed = seed;
      const Density density = banana(x_std, y_std);
      const InferenceResult r = answer_of(density, Method::automatic, options);
      if (!r.trusted) continue;
      ++trusted;
      expect_right(density, r);
    }
  EXPECT_GE(trusted, 3);
}

/// x ~ N(0, e^v), v ~ N(0, 3²) and the milder one of 1.5².
TEST(Densities, AFunnelThatIsTrustedIsRight) {
  for (const double sigma : {1.5, 3.0})
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      InferenceOptions options;
      options.seed = seed;
      options.samples = sigma > 2 ? 15000 : 10000;
      const Density density = {"funnel",
                               [sigma](const Vector& p) {
                                 const double v = p[0] / sigma;
                                 return -0.5 * v * v - 0.5 * p[1] * p[1] * std::exp(-p[0]) - 0.5 * p[0];
                               },
                               normals(2, 5), Vector::Zero(2),
                               Eigen::Vector2d(sigma, std::exp(sigma * sigma / 4))};
      const InferenceResult r = answer_of(density, Method::automatic, options);
      if (r.trusted) expect_right(density, r);
    }
}

TEST(Densities, WhatHasNoStandardDeviationIsNotTrusted) {
  for (const double nu : {1.0, 2.0})
    for (const Method method : {Method::automatic, Method::transport, Method::markov_chain}) {
      InferenceOptions options;
      if (method == Method::markov_chain)
        options.samples = 2000;  // else eight seconds of steps that converge nowhere
      const InferenceResult r = answer_of(student(nu), method, options);
      EXPECT_FALSE(r.trusted) << nu << " " << to_text(method) << ": " << r.verdict;
      if (method == Method::markov_chain) {  // which has none
        EXPECT_FALSE(r.budget_spent) << r.verdict;
      }
      if (method == Method::automatic) {
        EXPECT_NE(r.verdict.find("use the quantiles, which hold"), std::string::npos) << r.verdict;
      }
    }
  const double quartile = answer_of(student(1), Method::automatic).quantiles(0, 3);
  EXPECT_NEAR(quartile, 1, 0.1);  // Cauchy's
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    InferenceOptions options;
    options.seed = seed;
    const InferenceResult r = answer_of(student(5), Method::automatic, options);
    EXPECT_TRUE(r.trusted) << r.verdict;
    expect_right(student(5), r);
  }
}

/// Integrable, and without bound: eight schools, centred, about log τ, whose density grows as τ⁻⁸ where all θ
/// are μ. Improper: the same along a line where nothing holds it.
TEST(Densities, AnIntegrablePoleIsNotRefused) {
  const std::vector<double> y = {28, 8, -3, 7, -1, 1, 18, 12}, sigma = {15, 10, 16, 11, 9, 11, 10, 18};
  const auto log = [&](const Vector& p) {
    const double mu = p[8], tau = std::exp(p[9]);
    double sum = -0.5 * mu * mu / 25 - std::log1p(tau * tau / 25) + p[9];
    for (int j = 0; j < 8; ++j)
      sum += -0.5 * std::pow((y[j] - p[j]) / sigma[j], 2) - 0.5 * std::pow((p[j] - mu) / tau, 2) - p[9];
    return sum;
  };
  std::vector<Prior> region = normals(9, 10);
  region.push_back(Prior::normal(1.0, 1.5));
  const Density density = {"eight schools", log, region, Vector::Zero(10), Vector::Ones(10)};
  const InferenceResult r = answer_of(density, Method::automatic);
  EXPECT_LE(r.calls.evaluations, 20000);
  EXPECT_TRUE(r.mean.allFinite());
  const Density improper = {"improper", [](const Vector& p) { return -0.5 * p[0] * p[0]; }, normals(2, 1),
                            Vector::Zero(2), Vector::Ones(2)};
  EXPECT_THROW((void)answer_of(improper, Method::automatic), NumericalError);
}

TEST(Comparison, AgreesOrContradicts) {
  InferenceResult a;
  a.mean = Eigen::Vector2d(0, 1);
  a.covariance = Eigen::Matrix2d::Identity();
  a.quantiles.setZero(2, 5);
  a.log_evidence_error = 0.01;
  InferenceResult b = a;
  b.mean[1] += 0.12;
  EXPECT_FALSE(compare(a, b).contradict()) << compare(a, b).in_words();
  EXPECT_NE(compare(a, b).in_words().find("The two agree: means differ by at most 0.120 std"),
            std::string::npos);
  b.mean[1] += 0.05;
  EXPECT_TRUE(compare(a, b).contradict());
  b = a;
  b.covariance(0, 0) = 1.26 * 1.26;
  EXPECT_TRUE(compare(a, b).contradict());
  EXPECT_NE(compare(a, b).in_words().find("The two contradict each other"), std::string::npos);
  b = a;
  b.log_evidence = 0.1;
  EXPECT_TRUE(compare(a, b).contradict());
}

}  // namespace
}  // namespace knothe::assimilation
