#include "knothe/posterior/chains/adaptive_metropolis.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::posterior {
namespace {

using targets::Gaussian;
using targets::Planar;

/// |mean − exact| within `k` standard errors, variances within `k` of theirs, by the chains' own effective
/// size.
void expect_moments(const MetropolisResult& result, const Eigen::VectorXd& mean, const Eigen::VectorXd& std,
                    double k = 4.5) {
  const Eigen::VectorXd found = mean_of(result.sample), spread = covariance_of(result.sample).diagonal();
  for (Eigen::Index i = 0; i < mean.size(); ++i) {
    EXPECT_NEAR(found[i], mean[i], k * std[i] / std::sqrt(result.effective_sizes[i])) << i;
    EXPECT_NEAR(spread[i] / (std[i] * std[i]), 1, 2.5 * k / std::sqrt(result.effective_sizes[i])) << i;
  }
}

TEST(AdaptiveMetropolis, GaussianMomentsWithAndWithoutGradients) {
  Eigen::MatrixXd a = Eigen::MatrixXd::Identity(4, 4);
  for (Eigen::Index i = 0; i < 4; ++i)
    for (Eigen::Index j = 0; j < i; ++j) a(i, j) = 0.7;
  for (int derivatives : {0, 1, 2}) {
    Gaussian target(Eigen::Vector4d(0.5, -1, 0, 2), a * a.transpose());
    target.derivatives = derivatives;
    const MetropolisResult result = adaptive_metropolis(target, {.samples = 24000, .seed = 3});
    EXPECT_TRUE(result.converged) << result.r_hat.transpose() << " / " << result.effective_sizes.transpose();
    EXPECT_EQ(result.sample.points.rows(), 24000);
    EXPECT_EQ(result.chains, 4);
    EXPECT_GT(result.acceptance, derivatives == 0 ? 0.15 : 0.3);
    EXPECT_LT(result.acceptance, derivatives == 0 ? 0.5 : 0.7);
    EXPECT_NEAR(result.sample.weights.sum(), 1, 1e-12);
    EXPECT_FALSE(result.sample.has_evidence);
    const Eigen::MatrixXd covariance = target.precision.inverse();
    expect_moments(result, target.mean, covariance.diagonal().cwiseSqrt());
    EXPECT_GT(result.sample.effective_size, derivatives == 0 ? 1000 : 3000);
  }
}

TEST(AdaptiveMetropolis, TheBanana) {
  // x ~ N(0, 1), y | x ~ N(x², 1): mean of y 1, variance 1 + 2.
  for (int derivatives : {0, 2}) {
    Planar target(targets::banana(), derivatives);
    const MetropolisResult result = adaptive_metropolis(target, {.samples = 40000, .seed = 5});
    expect_moments(result, Eigen::Vector2d(0, 1), Eigen::Vector2d(1, std::sqrt(3.0)), 6);
    EXPECT_LT(result.r_hat.maxCoeff(), 1.05);
  }
}

/// Chains that say they have converged have standard deviations within four of the errors allowed, 2 %, over
/// seeds: y = x² + s ε has variance 2 + s².
TEST(AdaptiveMetropolis, ConvergedMeansThatTheDeviationsAreRight) {
  int converged = 0;
  for (const double s : {1.0, 0.3})
    for (std::uint64_t seed = 1; seed <= 15; ++seed) {
      Planar target(targets::banana(1, 0, s), 0);
      const MetropolisResult result =
          adaptive_metropolis(target, {.samples = 10000, .max_thinning = s < 1 ? 16 : 64, .seed = seed});
      if (!result.converged) continue;
      ++converged;
      const Eigen::VectorXd std = covariance_of(result.sample).diagonal().cwiseSqrt();
      EXPECT_NEAR(std[0], 1, 0.08) << "seed " << seed << ", s " << s;
      EXPECT_NEAR(std[1] / std::sqrt(2 + s * s), 1, 0.08) << "seed " << seed << ", s " << s;
    }
  EXPECT_GE(converged, 15);
}

TEST(AdaptiveMetropolis, ARidgeAgainstTheBoxByDenseQuadrature) {
  const targets::Ridge ridge{2, 1.05, 0.02, 1.2, 0.2};
  const targets::Reference reference = targets::dense_quadrature(ridge, {0.5});
  Planar target(ridge);
  const MetropolisResult result = adaptive_metropolis(target, {.samples = 40000, .seed = 2});
  expect_moments(result, reference.mean, reference.standard_deviation, 6);
}

TEST(AdaptiveMetropolis, ChainsInTwoModesDisagree) {
  Planar target(targets::mixture(12));
  const MetropolisResult result = adaptive_metropolis(target, {.samples = 8000, .seed = 1});
  EXPECT_FALSE(result.converged);
  EXPECT_GT(result.r_hat[0], 1.5);
  EXPECT_LT(result.sample.effective_size, 50);
}

TEST(AdaptiveMetropolis, ChainsThatHaveNotConvergedGoOn) {
  const targets::Ridge ridge{2, 1.05, 0.02, 1.2, 0.2};
  const targets::Reference reference = targets::dense_quadrature(ridge, {0.5});
  Planar target(ridge, 0);
  const MetropolisResult brief = adaptive_metropolis(target, {.samples = 4000, .max_thinning = 1, .seed = 5});
  EXPECT_FALSE(brief.converged);
  EXPECT_EQ(brief.thinning, 1);
  const MetropolisResult result =
      adaptive_metropolis(target, {.samples = 12000, .max_thinning = 512, .seed = 5});
  EXPECT_TRUE(result.converged);
  EXPECT_GT(result.thinning, 1);
  EXPECT_EQ(result.sample.points.rows(), 12000);
  EXPECT_GE(result.sample.density_evaluations, 12000 * result.thinning);
  expect_moments(result, reference.mean, reference.standard_deviation, 6);
}

TEST(AdaptiveMetropolis, TheSameSeedGivesTheSameChains) {
  Planar target(targets::banana());
  const auto run = [&](std::uint64_t seed) {
    return adaptive_metropolis(target, {.samples = 400, .warm_up = 200, .seed = seed}).sample.points;
  };
  const Eigen::MatrixXd first = run(7);
  (void)run(8);
  EXPECT_EQ(first, run(7));
  EXPECT_NE(first, run(8));
}

TEST(AdaptiveMetropolis, ChainsAdvanceInOneBatch) {
  struct Counting : Gaussian {
    using Gaussian::Gaussian;
    int calls = 0;
    void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
      ++calls;
      Gaussian::evaluate(z, order, out);
    }
  } target(Eigen::Vector2d(0, 0), Eigen::Matrix2d::Identity());
  const auto result = adaptive_metropolis(
      target, {.chains = 8, .samples = 800, .warm_up = 100, .max_thinning = 1, .seed = 1});
  EXPECT_LT(target.calls, 200 + 60);
  EXPECT_GE(result.sample.density_evaluations, 8 * 200);
}

TEST(AdaptiveMetropolis, ZeroDensityOutsideABoxIsNoTrouble) {
  Planar target(
      [](double x, double y, double* r) {
        r[0] = x > 0 && x < 1 && y > 0 && y < 1 ? -x : -std::numeric_limits<double>::infinity();
      },
      0);
  const auto result = adaptive_metropolis(target, {.samples = 20000, .seed = 4});
  const double mean = 1 - 1 / (std::exp(1.0) - 1);
  EXPECT_NEAR(mean_of(result.sample)[0], mean, 0.02);
  EXPECT_NEAR(mean_of(result.sample)[1], 0.5, 0.02);
}

TEST(AdaptiveMetropolis, ProgressAndInterruption) {
  Planar target(targets::banana());
  double last = -1;
  bool rises = true;
  (void)adaptive_metropolis(target, {.samples = 400, .warm_up = 100, .progress = [&](double share) {
                                       rises = rises && share >= last;
                                       last = share;
                                       return true;
                                     }});
  EXPECT_TRUE(rises);
  EXPECT_DOUBLE_EQ(last, 1);
  try {
    (void)adaptive_metropolis(
        target, {.samples = 400, .warm_up = 100, .progress = [](double share) { return share < 0.25; }});
    FAIL();
  } catch (const Interrupted& error) {
    EXPECT_EQ(std::string(error.what()), "mcmc: interrupted after 100 of 200 steps");
  }
}

TEST(AdaptiveMetropolis, BadOptionsAreRefused) {
  Planar target(targets::banana());
  const auto message = [&](const MetropolisOptions& options) {
    try {
      (void)adaptive_metropolis(target, options);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message({.chains = 1}), "mcmc: 1 chains; at least 2 are needed to see whether they agree");
  EXPECT_EQ(message({.samples = 10}), "mcmc: 10 samples for 4 chains; at least 4 a chain are needed");
  EXPECT_EQ(message({.warm_up = -1}), "mcmc: a warm-up of -1 draws");
}

}  // namespace
}  // namespace knothe::posterior
