#include "knothe/likelihood/discrepancy/model_bias.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>

#include "knothe/assimilation/monitor/model_selection.hpp"
#include "knothe/assimilation/testing/test_priors.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/base/error.hpp"
#include "knothe/likelihood/testing/front_model.hpp"
#include "knothe/likelihood/testing/test_models.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::assimilation {
namespace {

using likelihood::test::CurvedFunctions;
using likelihood::test::Front;
using likelihood::test::LinearFunctions;
using likelihood::test::random_model;
using likelihood::test::synthetic_data;
using test::papers_priors;

double normal_log_density(const Eigen::VectorXd& x, const Eigen::MatrixXd& covariance) {
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  return -0.5 * (x.dot(factor.solve(x)) + static_cast<double>(x.size()) * std::log(2 * M_PI)) -
         factor.matrixLLT().diagonal().array().log().sum();
}

double log_likelihood(const likelihood::StepForm& form, const Eigen::VectorXd& v) {
  return -0.5 * (v.dot(form.quadratic * v) - 2 * form.linear.dot(v) + form.constant + form.log_normaliser);
}

TEST(TimeExtrapolation, PolynomialsGoOnAsTheyAre) {
  const std::vector<double> times = {0.1, 0.2, 0.35, 0.4, 0.6, 0.65};
  std::vector<double> line, parabola;
  for (const double t : times) line.push_back(2 - 3 * t), parabola.push_back(1 + t - 4 * t * t);
  for (const int window : {2, 4, 6}) {
    EXPECT_NEAR(likelihood::extrapolate(1, window, times, line, 0.8), 2 - 3 * 0.8, 1e-12);
    EXPECT_NEAR(likelihood::extrapolate(2, window, times, parabola, 0.8), 1 + 0.8 - 4 * 0.64, 1e-12);
    EXPECT_NEAR(likelihood::extrapolate(0, 1, times, line, 0.8), line.back(), 1e-15);
  }
  const std::vector<double> constant(6, 7.0);
  EXPECT_NEAR(likelihood::extrapolate(1, 2, times, constant, 0.8), 7, 1e-12);
  EXPECT_EQ(likelihood::extrapolate(1, 2, std::span(times).first(1), std::span(line).first(1), 0.2), line[0]);
}

TEST(ModelBias, LinearModesGoOnLinearly) {
  const Eigen::Index n = 12;
  const Eigen::MatrixXd shapes = numerics::monte_carlo_normal_points(n, 2, 1);
  const Eigen::VectorXd noise = Eigen::VectorXd::LinSpaced(n, 0.5, 2);
  for (const auto way : {likelihood::BiasOptions::Way::modes, likelihood::BiasOptions::Way::published}) {
    likelihood::BiasOptions options;
    options.way = way;
    likelihood::ModelBias bias(noise, options);
    EXPECT_FALSE(bias.extrapolate(0.0).has_value());
    EXPECT_FALSE(bias.latest().has_value());
    const auto residual = [&](double t) -> Eigen::VectorXd {
      return shapes.col(0) * (3 * t) + shapes.col(1) * (1 - 2 * t);
    };
    for (int i = 0; i < 10; ++i) bias.add(i, residual(i), Eigen::VectorXd::Constant(n, 0.3));
    EXPECT_LT((*bias.latest() - residual(9)).norm(), 1e-9 * residual(9).norm());
    const likelihood::BiasCorrection next = *bias.extrapolate(10);
    EXPECT_LT((next.mean - residual(10)).norm(), 1e-9 * residual(10).norm());
    for (Eigen::Index i = 0; i < n; ++i)
      EXPECT_NEAR(next.scale[i], std::sqrt(1 + 0.09 / (noise[i] * noise[i])), 1e-9);
  }
}

/// Eq. 19-20: the columns' singular value decomposition, cut after `rank` modes, whose time modes go on along
/// the line through their last two values.
Eigen::VectorXd next_by_modes(const Eigen::MatrixXd& columns, const std::vector<double>& times, double time,
                              Eigen::Index rank) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(columns, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const Eigen::Index last = columns.cols() - 1;
  Eigen::VectorXd next = Eigen::VectorXd::Zero(columns.rows());
  for (Eigen::Index k = 0; k < std::min(rank, svd.singularValues().size()); ++k) {
    double v = svd.matrixV()(last, k);
    if (last > 0) {
      const double before = times[times.size() - 2], here = times.back();
      v += (time - here) / (here - before) * (v - svd.matrixV()(last - 1, k));
    }
    next += svd.matrixU().col(k) * svd.singularValues()[k] * v;
  }
  return next;
}

/// Eq. 16-20 written out, densely and in the data's own units, for a model that is linear in p with normal
/// priors, whose posterior is a conjugate formula.
TEST(ModelBias, ThePublishedCorrectionIsEquations16To20WrittenOut) {
  const Eigen::Index n = 5, d = 2, n_t = 14;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(d), n, 4, n_t, 19);
  const double noise = 0.3;
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, noise);
  Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(0.4, -0.7), std, 5);
  const Eigen::VectorXd shape = numerics::monte_carlo_normal_points(n, 1, 6);
  for (Eigen::Index t = 5; t < n_t; ++t) data.col(t) += static_cast<double>(t - 4) * shape;
  UpdateOptions options;
  options.bias_correction = likelihood::BiasCorrectionMode::on;
  options.bias.way = likelihood::BiasOptions::Way::published;
  SequentialUpdate update(model, likelihood::NoiseModel::independent(std),
                          {posterior::Prior::normal(0, 1), posterior::Prior::normal(0, 1)}, options);

  Eigen::MatrixXd information = Eigen::MatrixXd::Identity(d, d), means(n, 0), stds(n, 0);
  Eigen::VectorXd weighted = Eigen::VectorXd::Zero(d);
  double log_evidence = 0;
  std::vector<double> times;
  int above_the_noise = 0;
  for (Eigen::Index t = 0; t < n_t; ++t) {
    const auto step = static_cast<std::size_t>(t);
    const Eigen::MatrixXd seen = model->space * model->core[step];
    Eigen::VectorXd bias = Eigen::VectorXd::Zero(n), spread = std;
    if (t > 0) {
      bias = next_by_modes(means, times, model->time[step], 2);
      spread = next_by_modes(stds, times, model->time[step], 2);
      above_the_noise += (spread.array() > noise).all();
      spread = spread.cwiseMax(noise);  // std(B)² = std(e)² + std(M)² cannot be less
    }
    const Eigen::VectorXd rest = data.col(t) - model->lift.col(t) - bias;  // Eq. 17-18
    const Eigen::MatrixXd before = information.inverse();
    Eigen::MatrixXd predictive = seen * before * seen.transpose();
    predictive.diagonal() += spread.cwiseAbs2();
    log_evidence += normal_log_density(rest - seen * before * weighted, predictive);
    const Eigen::MatrixXd scaled = spread.cwiseAbs2().cwiseInverse().asDiagonal() * seen;
    information += seen.transpose() * scaled;
    weighted += scaled.transpose() * rest;
    const Eigen::MatrixXd covariance = information.inverse();
    const Eigen::VectorXd mean = covariance * weighted;

    const UpdateResult& result = update.update(step, step, data.col(t));
    EXPECT_EQ(result.bias_corrected, t > 0);
    for (Eigen::Index a = 0; a < d; ++a)
      EXPECT_NEAR(result.mean[a], mean[a], 0.01 * std::sqrt(covariance(a, a))) << t;
    EXPECT_LT((result.covariance - covariance).norm(), 0.01 * covariance.norm()) << t;
    EXPECT_NEAR(result.log_evidence, log_evidence, 0.01 * static_cast<double>(t + 1)) << t;

    means.conservativeResize(Eigen::NoChange, t + 1);
    stds.conservativeResize(Eigen::NoChange, t + 1);
    means.col(t) = data.col(t) - model->lift.col(t) - seen * mean;  // Eq. 16, 19
    stds.col(t) = (noise * noise + (seen * covariance * seen.transpose()).diagonal().array()).sqrt();
    times.push_back(model->time[step]);
  }
  EXPECT_GT(above_the_noise, 3);  // the bound is not what is tested
}

TEST(ModelBias, LinearAndPublishedDifferByTheModesErrorAlone) {
  const Eigen::Index n = 6;
  const Eigen::VectorXd noise = Eigen::VectorXd::Constant(n, 0.5);
  likelihood::ModelBias linear(noise, {.way = likelihood::BiasOptions::Way::modes}),
      published(noise, {.way = likelihood::BiasOptions::Way::published});
  const Eigen::MatrixXd residuals = 3 * numerics::monte_carlo_normal_points(n, 8, 3);
  for (int i = 0; i < 8; ++i)
    for (likelihood::ModelBias* bias : {&linear, &published})
      bias->add(i, residuals.col(i), Eigen::VectorXd::Constant(n, 0.3));
  const likelihood::BiasCorrection a = *linear.extrapolate(8), b = *published.extrapolate(8);
  EXPECT_EQ(a.mean, b.mean);
  EXPECT_EQ(a.scale, b.scale);
  EXPECT_GT(a.factor.norm(), 0);
  EXPECT_EQ(b.factor.cols(), 0);
  EXPECT_EQ(*linear.latest(), *published.latest());
}

TEST(ModelBias, TheStandardDeviationIsNeverBelowThatOfTheMeasurement) {
  likelihood::ModelBias bias(Eigen::VectorXd::Ones(3), {.way = likelihood::BiasOptions::Way::modes});
  bias.add(0, Eigen::Vector3d(1, 2, 3), Eigen::Vector3d::Constant(2.0));
  bias.add(1, Eigen::Vector3d(1, std::nan(""), 3), Eigen::Vector3d::Constant(0.1));
  const likelihood::BiasCorrection next = *bias.extrapolate(2);  // the line goes to a negative one
  EXPECT_EQ(next.scale, Eigen::Vector3d(1, 1, 1));
  EXPECT_TRUE(next.mean.allFinite());
  EXPECT_NEAR(next.mean[1], 2, 1e-9);  // missing: what was expected there
}

TEST(ModelBias, TheCorrectedLikelihoodIsTheNormalDensityWrittenOut) {
  const Eigen::Index n = 7, d = 3;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(d), n, 4, 2, 11);
  const Eigen::VectorXd std = Eigen::VectorXd::LinSpaced(n, 0.2, 0.5);
  const Eigen::VectorXd centre = Eigen::Vector3d(0.1, 0.2, 0.3);
  likelihood::DatumProjector projector(model, likelihood::NoiseModel::independent(std), centre);
  likelihood::BiasCorrection correction;
  correction.mean = numerics::monte_carlo_normal_points(n, 1, 2);
  correction.scale = 1 + numerics::monte_carlo_points(n, 1, 3).col(0).array();
  correction.factor = numerics::monte_carlo_normal_points(n, 2, 4);
  Eigen::VectorXd values = numerics::monte_carlo_normal_points(n, 1, 5);
  likelihood::StepForm form;
  for (const bool complete : {true, false}) {
    std::vector<Eigen::Index> kept = {0, 1, 2, 3, 4, 5, 6};
    if (!complete) kept = {0, 2, 3, 6}, values[1] = values[4] = values[5] = std::nan("");
    projector.project(1, 1, values, correction, form);
    const Eigen::VectorXd s = correction.scale.cwiseProduct(std);
    Eigen::MatrixXd covariance = correction.factor * correction.factor.transpose();
    covariance.diagonal() += s.cwiseAbs2();
    for (const double a : {-1.0, 0.5, 2.0}) {
      const Eigen::VectorXd p = Eigen::Vector3d(a, 1 - a, 0.3 * a);
      const Eigen::VectorXd rest = values - model->predict(p, 1) - correction.mean;
      EXPECT_NEAR(log_likelihood(form, p - centre), normal_log_density(rest(kept), covariance(kept, kept)),
                  1e-9);
    }
  }
}

/// The data of all steps at once: covariance R δ_ts + κ² A_t F ρ^|t−s| Fᵀ A_sᵀ.
TEST(JointDiscrepancy, SumsToTheJointDensityOfAllData) {
  const Eigen::Index n = 5, d = 3, n_t = 6;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(d), n, 4, n_t, 7);
  const Eigen::VectorXd std = Eigen::VectorXd::LinSpaced(n, 0.2, 0.5);
  const Eigen::VectorXd centre = Eigen::Vector3d(0.1, 0.2, 0.3);
  likelihood::DatumProjector projector(model, likelihood::NoiseModel::independent(std), centre);
  const Eigen::MatrixXd factor = numerics::monte_carlo_normal_points(d, 2, 9);
  const double kappa = 0.4, memory = 3, rho = std::exp(-1 / memory);
  likelihood::JointDiscrepancy joint(factor, kappa, memory);
  const Eigen::MatrixXd data = numerics::monte_carlo_normal_points(n, n_t, 5);
  likelihood::StepForm sum = likelihood::StepForm::zero(d), form;
  Eigen::MatrixXd covariance(n * n_t, n * n_t), with_last(d, n * n_t);
  for (Eigen::Index t = 0; t < n_t; ++t) {
    projector.project(static_cast<std::size_t>(t), static_cast<std::size_t>(t), data.col(t), form);
    sum.add(joint.condition(form));
    const Eigen::MatrixXd seen = kappa * model->space * model->core[static_cast<std::size_t>(t)] * factor;
    with_last.middleCols(n * t, n) =
        std::pow(rho, static_cast<double>(n_t - 1 - t)) * kappa * factor * seen.transpose();
    for (Eigen::Index s = 0; s < n_t; ++s) {
      const Eigen::MatrixXd left = kappa * model->space * model->core[static_cast<std::size_t>(t)] * factor;
      const Eigen::MatrixXd right = kappa * model->space * model->core[static_cast<std::size_t>(s)] * factor;
      covariance.block(n * t, n * s, n, n) =
          std::pow(rho, static_cast<double>(std::abs(t - s))) * left * right.transpose();
    }
    covariance.block(n * t, n * t, n, n).diagonal() += std.cwiseAbs2();
  }
  for (const double a : {-1.0, 0.5, 2.0}) {
    const Eigen::VectorXd p = Eigen::Vector3d(a, 1 - a, 0.3 * a);
    Eigen::VectorXd rest(n * n_t);
    for (Eigen::Index t = 0; t < n_t; ++t)
      rest.segment(n * t, n) = data.col(t) - model->predict(p, static_cast<std::size_t>(t));
    const double exact = normal_log_density(rest, covariance);
    EXPECT_NEAR(log_likelihood(sum, p - centre), exact, 1e-9 * std::abs(exact));
    const Eigen::VectorXd expected = with_last * covariance.llt().solve(rest);
    EXPECT_LT((joint.expected(p - centre) - expected).norm(), 1e-9 * (1 + expected.norm()));
  }
}

TEST(CollapsedLogDensity, AMixtureHasExactDerivatives) {
  const auto functions = std::make_shared<likelihood::test::CurvedFunctions>();
  const auto transform = std::make_shared<const posterior::PriorTransform>(std::vector<posterior::Prior>{
      papers_priors()[0].truncated(0.5, 1.5, "a"), papers_priors()[1].truncated(0.5, 1.5, "b")});
  likelihood::CollapsedLogDensity density(functions, transform, Eigen::Vector3d(1, 0.8, 0.5));
  std::vector<likelihood::StepForm> forms(3, likelihood::StepForm::zero(3));
  for (int k = 0; k < 3; ++k) {
    forms[k].quadratic.diagonal().setConstant(2.0 * (k + 1));
    forms[k].linear << 1, 0.4 * k, -0.3;
    forms[k].constant = k;
  }
  const likelihood::StepForm* const parts[] = {&forms[0], &forms[1], &forms[2]};
  density.set_mixture(parts, std::array{-1.0, -0.5, -2.0});
  likelihood::test::expect_exact_derivatives(density, {{0.1, -0.4}, {-1.3, 0.9}, {2.0, 2.0}});
  posterior::LogDensityBatch all, one;
  all.resize(1, 2, 0), one.resize(1, 2, 0);
  const Eigen::RowVector2d p(1.1, 0.7);
  density.evaluate_likelihood(p, 0, all);
  double sum = 0;
  for (int k = 0; k < 3; ++k) {
    density.set_form(forms[k]);
    density.evaluate_likelihood(p, 0, one);
    sum += std::exp(one.value[0] + std::array{-1.0, -0.5, -2.0}[k]);
  }
  EXPECT_NEAR(all.value[0], std::log(sum), 1e-12);
}

TEST(CollapsedLogDensity, AMixtureOnAGridIsWhatItIsAtItsPoints) {
  const auto transform = std::make_shared<const posterior::PriorTransform>(std::vector<posterior::Prior>{
      papers_priors()[0].truncated(0.5, 1.5, "a"), papers_priors()[1].truncated(0.5, 1.5, "b")});
  const std::shared_ptr<const model::ParameterFunctions> kinds[] = {
      std::make_shared<likelihood::test::CurvedFunctions>(), likelihood::test::Front().model->functions};
  for (const auto& functions : kinds) {
    likelihood::CollapsedLogDensity density(functions, transform, Eigen::Vector3d(1, 0.8, 0.5));
    std::vector<likelihood::StepForm> forms(3, likelihood::StepForm::zero(3));
    for (int k = 0; k < 3; ++k) forms[k].quadratic.diagonal().setConstant(2.0 * (k + 1));
    const likelihood::StepForm* const parts[] = {&forms[0], &forms[1], &forms[2]};
    density.set_mixture(parts, std::array{-1.0, -0.5, -2.0}, std::array{0.4, 0.6, 1e-6});
    Eigen::MatrixXd axes(9, 2);
    axes.col(0).setLinSpaced(9, -6, 8);
    axes.col(1).setLinSpaced(9, -1, 3);
    const std::vector<numerics::GridRun> runs = {{1, 2, 7, 0}, {4, 0, 9, 5}, {4, 3, 4, 14}, {8, 8, 9, 15}};
    const Eigen::MatrixXd z = numerics::nodes_of(axes, runs);
    Eigen::MatrixXd p(16, 2), none;
    transform->evaluate(z, 0, p, none, none);
    posterior::LogDensityBatch at_points;
    at_points.resize(16, 2, 0);
    density.evaluate(z, 0, at_points);
    Eigen::VectorXd on_grid(16);
    density.set_grid(axes);
    density.evaluate_runs(runs, on_grid);
    EXPECT_LT((on_grid - at_points.value).cwiseAbs().maxCoeff(), 1e-11);
    const Eigen::VectorXd weights = Eigen::VectorXd::LinSpaced(16, 1, 2) / 24;
    const Eigen::VectorXd shares = density.component_shares(runs, weights);
    EXPECT_LT((shares - density.component_shares(p, weights)).norm(), 1e-12);
    EXPECT_NEAR(shares.sum(), 1, 1e-14);  // all three parts, felt or not
  }
}

TEST(Cusum, ThresholdsAreThePublishedOnes) {
  // One-sided average run lengths at reference ½: 335.4 for h = 4, 930.9 for h = 5 (D. C. Montgomery,
  // Statistical Quality Control: two-sided 168 and 465).
  EXPECT_NEAR(cusum_threshold(0.5, 335.4), 4, 0.01);
  EXPECT_NEAR(cusum_threshold(0.5, 930.9), 5, 0.01);
}

TEST(Cusum, FalseAlarmsComeAsSeldomAsStated) {
  // 2,000 runs of 60 steps at a run length of 600: run lengths are geometric from the stationary state, so
  // fewer than 1 − (1 − 1/600)^60 = 9.5 % ring; exact binomial 99 % bound from above.
  const double threshold = cusum_threshold(0.5, 600);
  const Eigen::MatrixXd z = numerics::monte_carlo_normal_points(60, 2000, 4);
  int rang = 0;
  for (Eigen::Index run = 0; run < z.cols(); ++run) {
    Cusum sum(0.5, threshold);
    bool alarm = false;
    for (Eigen::Index i = 0; i < z.rows(); ++i) alarm = sum.add(z(i, run)) || alarm;
    rang += alarm;
  }
  EXPECT_LT(rang, 225);
  EXPECT_GT(rang, 100);
}

TEST(EvidenceMonitor, TransformsAreUniformWhileTheModelIsRight) {
  // A curved posterior, truths from the prior, noise as stated: 40 runs of 6 steps. Of 240 independent
  // uniform numbers, below 0.1 fall 24; binomial 99 % bounds 12 and 38, between 0.4 and 0.6 fall 48: 32 and
  // 65.
  const Eigen::Index n = 10;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 6, 21);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.3);
  int low = 0, high = 0, middle = 0;
  for (unsigned run = 0; run < 40; ++run) {
    SequentialUpdate update(model, likelihood::NoiseModel::independent(std), papers_priors());
    const Eigen::MatrixXd z = numerics::monte_carlo_normal_points(1, 2, 100 + run);
    Eigen::Vector2d truth;
    for (int k = 0; k < 2; ++k) truth[k] = update.transform().prior(k).from_standard_normal(z(0, k)).value;
    const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, truth, std, 1000 + run);
    for (std::size_t t = 0; t < 6; ++t) {
      const double u = update.update(t, t, data.col(static_cast<Eigen::Index>(t))).monitor.upper_probability;
      low += u<0.1, high += u> 0.9, middle += u > 0.4 && u < 0.6;
    }
  }
  EXPECT_GE(low, 12);
  EXPECT_LE(low, 38);
  EXPECT_GE(high, 12);
  EXPECT_LE(high, 38);
  EXPECT_GE(middle, 32);
  EXPECT_LE(middle, 65);
}

TEST(EvidenceMonitor, ABiasOfThreeSigmaOnATenthOfSixtySensorsIsFoundWithinFivePictures) {
  const Eigen::Index n = 60;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(2), n, 4, 12, 5);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.3);
  const std::vector<posterior::Prior> priors = {posterior::Prior::normal(0, 1),
                                                posterior::Prior::normal(0, 1)};
  int found = 0, false_alarms = 0;
  const int runs = 60;
  for (unsigned run = 0; run < runs; ++run) {
    SequentialUpdate update(model, likelihood::NoiseModel::independent(std), priors);
    Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(0.4, -0.7), std, run);
    data.block(10 * (run % 5), 6, 6, 6).array() += 3 * 0.3;
    bool before = false, after = false;
    for (std::size_t t = 0; t < 11; ++t) {
      const UpdateResult& r = update.update(t, t, data.col(static_cast<Eigen::Index>(t)));
      (t < 6 ? before : after) |= r.monitor.alarm;
    }
    found += after, false_alarms += before;
  }
  EXPECT_GE(found, 52);  // P(fewer | 0.95) < 0.005
  EXPECT_LE(false_alarms, 1);
}

TEST(ModelSelection, ProbabilitiesAndWords) {
  const std::vector<double> p = model_probabilities({-1000, -1000 + std::log(3.0), -5000});
  EXPECT_NEAR(p[0], 0.25, 1e-12);
  EXPECT_NEAR(p[1], 0.75, 1e-12);
  EXPECT_EQ(p[2], 0);
  EXPECT_EQ(jeffreys_scale(0.1), "barely worth mentioning");
  EXPECT_EQ(jeffreys_scale(-std::log(20.0)), "strong");
  EXPECT_EQ(jeffreys_scale(std::log(101.0)), "decisive");
}

TEST(ModelBias, RedoneOrSwitchedOnByItselfIsAReplayFromScratchBitByBit) {
  const likelihood::test::Front front;
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(likelihood::test::Front::n, front.error);
  const Eigen::MatrixXd data = likelihood::test::Front::field(0.8, 1.2) +
                               front.error * numerics::monte_carlo_normal_points(
                                                 likelihood::test::Front::n, likelihood::test::Front::n_t, 3);
  const auto run = [&](SequentialUpdate& update, Eigen::Index steps) {
    for (Eigen::Index t = 0; t < steps; ++t)
      update.update(static_cast<std::size_t>(t), static_cast<std::size_t>(t), data.col(t));
  };
  for (const auto way : {likelihood::BiasOptions::Way::joint, likelihood::BiasOptions::Way::modes,
                         likelihood::BiasOptions::Way::published}) {
    UpdateOptions options;
    options.bias.way = way;
    options.learn_bias = true;
    SequentialUpdate late(front.model, likelihood::NoiseModel::independent(std), papers_priors(), options);
    SequentialUpdate early(front.model, likelihood::NoiseModel::independent(std), papers_priors(), options);
    early.correct_bias(3, 7);
    run(late, 10), run(early, 10);
    EXPECT_NE(late.result().mean, early.result().mean);
    late.correct_bias(3, 7);
    EXPECT_EQ(late.corrected_steps(), (std::vector<std::size_t>{3, 4, 5, 6, 7}));
    EXPECT_EQ(late.result().mean, early.result().mean);
    EXPECT_EQ(late.result().covariance, early.result().covariance);
    EXPECT_EQ(late.result().log_evidence, early.result().log_evidence);
    EXPECT_EQ(late.result().points, early.result().points);
    EXPECT_EQ(late.result().weights, early.result().weights);

    options.bias_correction = likelihood::BiasCorrectionMode::automatic;
    SequentialUpdate by_itself(front.model, likelihood::NoiseModel::independent(std), papers_priors(),
                               options);
    run(by_itself, likelihood::test::Front::n_t);
    const std::vector<std::size_t> corrected = by_itself.corrected_steps();
    ASSERT_FALSE(corrected.empty());
    options.bias_correction = likelihood::BiasCorrectionMode::off;
    SequentialUpdate replay(front.model, likelihood::NoiseModel::independent(std), papers_priors(), options);
    for (const std::size_t step : corrected) replay.correct_bias(step, step);
    run(replay, likelihood::test::Front::n_t);
    if (corrected.back() - corrected.front() + 1 == corrected.size()) {
      EXPECT_EQ(by_itself.result().mean, replay.result().mean);
      EXPECT_EQ(by_itself.result().log_evidence, replay.result().log_evidence);
    }
  }
  SequentialUpdate forgets(front.model, likelihood::NoiseModel::independent(std), papers_priors());
  EXPECT_THROW(forgets.correct_bias(0, 1), UsageError);
}

TEST(ModelBias, TheAlarmAndWhatIsDoneAboutItAreSaidInWords) {
  const likelihood::test::Front front;
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(likelihood::test::Front::n, front.error);
  UpdateOptions options;
  options.bias_correction = likelihood::BiasCorrectionMode::automatic;
  SequentialUpdate update(front.model, likelihood::NoiseModel::independent(std), papers_priors(), options);
  std::string words;
  for (Eigen::Index t = 0; t < likelihood::test::Front::n_t; ++t) {
    const auto step = static_cast<std::size_t>(t);
    const UpdateResult& r = update.update(step, step, likelihood::test::Front::field(0.8, 1.2).col(t));
    if (words.empty()) words = r.notice;
    if (!r.notice.empty()) {
      EXPECT_TRUE(r.bias_corrected);
    }
  }
  EXPECT_TRUE(words.find("the model does not fit the data") != std::string::npos || words.empty());
}

}  // namespace
}  // namespace knothe::assimilation
