#include "knothe/posterior/draws/adaptive_importance.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/posterior/testing/importance_checks.hpp"

namespace knothe::posterior {
namespace {

using targets::KnownMixture;

void expect_right(KnownMixture& target, double log_evidence, const AdaptiveImportanceOptions& options = {}) {
  const AdaptiveImportanceResult r = adaptive_importance(target, options);
  ASSERT_TRUE(r.converged) << r.mean_error << " " << r.deviation_error << " " << r.missed;
  const Eigen::VectorXd mean = mean_of(r.sample), deviation = target.variance().cwiseSqrt();
  const Eigen::VectorXd found = covariance_of(r.sample).diagonal().cwiseSqrt();
  EXPECT_LE(((mean - target.mean()).array() / deviation.array()).abs().maxCoeff(), r.mean_error);
  EXPECT_LE((found.array() / deviation.array() - 1).abs().maxCoeff(), r.deviation_error);
  EXPECT_NEAR(r.sample.log_evidence, log_evidence, 5 * r.sample.log_evidence_error + 1e-3);
  EXPECT_NEAR(r.sample.weights.sum(), 1, 1e-12);
}

TEST(AdaptiveImportance, ANarrowCorrelatedGaussian) {
  const Eigen::Index d = 6;
  Eigen::MatrixXd lower = 0.02 * Eigen::MatrixXd::Identity(d, d);
  lower.bottomLeftCorner(3, 3).setConstant(0.05);
  KnownMixture target({{1.0, Eigen::VectorXd::LinSpaced(d, -1, 1), lower}}, -321.5);
  expect_right(target, -321.5);
}

TEST(AdaptiveImportance, TwoModesOfUnequalWeightFarApart) {
  const Eigen::Index d = 5;
  for (const double light : {0.5, 0.1, 0.02}) {
    KnownMixture target(
        {{1 - light, Eigen::VectorXd::Constant(d, 0.8), 0.1 * Eigen::MatrixXd::Identity(d, d)},
         {light, Eigen::VectorXd::Constant(d, -0.8), 0.1 * Eigen::MatrixXd::Identity(d, d)}},
        12.0);
    expect_right(target, 12.0);
  }
}

TEST(AdaptiveImportance, TheSameTargetGivesTheSameDrawsAndAnotherSeedOthers) {
  targets::expect_a_function_of_target_and_seed<AdaptiveImportanceOptions>(adaptive_importance);
}

TEST(AdaptiveImportance, StatedErrorsAreFourStandardErrors) {
  AdaptiveImportanceOptions options;
  options.particles = 400;
  const double ratio = targets::errors_in_units_of_those_stated(adaptive_importance, options);
  EXPECT_LT(ratio, 1.3);
  EXPECT_GT(ratio, 0.3);
}

TEST(AdaptiveImportance, SaysThatItHasNotConverged) {
  targets::Shell shell;
  AdaptiveImportanceOptions options;
  options.particles = 200;
  options.attempts = 1;
  options.max_rounds = 2;
  const auto r = adaptive_importance(shell, options);
  EXPECT_FALSE(r.converged);
  EXPECT_TRUE(r.sample.points.allFinite());
  EXPECT_NEAR(r.sample.weights.sum(), 1, 1e-12);
}

}  // namespace
}  // namespace knothe::posterior
