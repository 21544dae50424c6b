#include "knothe/sampling/adaptive_importance.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/sampling/testing/known_mixture.hpp"

namespace knothe::sampling {
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
  KnownMixture target({{1.0, Eigen::VectorXd::Zero(3), 0.3 * Eigen::MatrixXd::Identity(3, 3)}}, 0);
  AdaptiveImportanceOptions options;
  const auto first = adaptive_importance(target, options), again = adaptive_importance(target, options);
  EXPECT_EQ(first.sample.points, again.sample.points);
  EXPECT_EQ(first.sample.weights, again.sample.weights);
  options.seed = 2;
  EXPECT_NE(first.sample.points, adaptive_importance(target, options).sample.points);
}

TEST(AdaptiveImportance, StatedErrorsAreFourStandardErrors) {
  // Over many seeds: the error of the mean in units of what is stated.
  KnownMixture target({{0.6, Eigen::Vector3d(1, 0, 0), 0.3 * Eigen::MatrixXd::Identity(3, 3)},
                       {0.4, Eigen::Vector3d(-1, 0.5, 0), 0.4 * Eigen::MatrixXd::Identity(3, 3)}},
                      0);
  const Eigen::VectorXd deviation = target.variance().cwiseSqrt();
  AdaptiveImportanceOptions options;
  options.particles = 400;
  double squares = 0, stated = 0;
  constexpr int k_seeds = 60;
  for (int seed = 1; seed <= k_seeds; ++seed) {
    options.seed = static_cast<std::uint64_t>(seed);
    const auto r = adaptive_importance(target, options);
    squares += ((mean_of(r.sample) - target.mean()).array() / deviation.array()).square().mean();
    stated += std::pow(r.mean_error / 4, 2);
  }
  EXPECT_LT(squares / stated, 1.3);
  EXPECT_GT(squares / stated, 0.3);
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
}  // namespace knothe::sampling
