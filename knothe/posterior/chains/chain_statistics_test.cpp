#include "knothe/posterior/chains/chain_statistics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/posterior/random_numbers.hpp"

namespace knothe::posterior {
namespace {

/// x_t = ρ x_{t−1} + √(1 − ρ²) ξ_t, stationary.
Eigen::MatrixXd autoregressive(Eigen::Index n, Eigen::Index chains, double rho, std::uint64_t seed) {
  RandomNumbers random(seed);
  Eigen::MatrixXd x(n, chains);
  for (Eigen::Index c = 0; c < chains; ++c) {
    x(0, c) = random.normal();
    for (Eigen::Index t = 1; t < n; ++t)
      x(t, c) = rho * x(t - 1, c) + std::sqrt(1 - rho * rho) * random.normal();
  }
  return x;
}

TEST(ChainStatistics, RHatOfASmallExampleByHand) {
  // One chain 1 … 8: halves (1 2 3 4), (5 6 7 8). Scores q_r = Φ⁻¹((r − 3/8)/8.25) are antisymmetric, so the
  // halves' means are ∓m and their variances equal.
  const Eigen::VectorXd draws = Eigen::VectorXd::LinSpaced(8, 1, 8);
  double q[4], mean = 0, variance = 0;
  for (int r = 0; r < 4; ++r) q[r] = numerics::normal_quantile((r + 0.625) / 8.25), mean += q[r] / 4;
  for (double s : q) variance += (s - mean) * (s - mean) / 3;
  const double between = 2 * mean * mean;  // sample variance of (−m, m)
  EXPECT_NEAR(split_r_hat(draws), std::sqrt((0.75 * variance + between) / variance), 1e-12);
}

TEST(ChainStatistics, FoldedRHatSeesAChainThatIsTooWide) {
  // Same medians, other spreads: only the distance from the median tells.
  Eigen::MatrixXd draws = autoregressive(2000, 4, 0, 5);
  EXPECT_LT(split_r_hat(draws), 1.01);
  draws.col(2) *= 3;
  EXPECT_GT(split_r_hat(draws), 1.05);
}

TEST(ChainStatistics, RHatSeesAShiftedChainAndIsFreeOfMoments) {
  Eigen::MatrixXd draws = autoregressive(2000, 4, 0.5, 6);
  EXPECT_LT(split_r_hat(draws), 1.01);
  draws.col(0).array() += 1;
  const double shifted = split_r_hat(draws);
  EXPECT_GT(shifted, 1.05);
  // Ranks only: a monotone change that has no finite moments changes nothing but the folded part.
  const Eigen::MatrixXd wild = draws.array().sinh();
  EXPECT_GT(split_r_hat(wild), 1.05);
}

TEST(ChainStatistics, EffectiveSizeIsThatOfAutoregressiveTheory) {
  // Integrated autocorrelation time of AR(1): (1 + ρ)/(1 − ρ). The estimate scatters by some 5 % at this
  // length.
  for (double rho : {0.0, 0.5, 0.9, 0.97}) {
    const double n = 4 * 40000, expected = n * (1 - rho) / (1 + rho);
    EXPECT_NEAR(effective_sample_size(autoregressive(40000, 4, rho, 7)) / expected, 1, 0.1) << rho;
  }
  // Antithetic: more than there are draws; ρ = −0.5 gives three times as many.
  EXPECT_NEAR(effective_sample_size(autoregressive(40000, 4, -0.5, 8)) / (3 * 160000), 1, 0.1);
}

TEST(ChainStatistics, ChainsThatDisagreeHaveFewEffectiveDraws) {
  Eigen::MatrixXd draws = autoregressive(2000, 4, 0, 9);
  draws.col(1).array() += 5;
  EXPECT_LT(effective_sample_size(draws), 20);
}

TEST(ChainStatistics, WhatDoesNotVary) {
  EXPECT_DOUBLE_EQ(split_r_hat(Eigen::MatrixXd::Constant(10, 2, 0.1)), 1);
  EXPECT_DOUBLE_EQ(effective_sample_size(Eigen::MatrixXd::Constant(10, 2, 0.1)), 1);
  Eigen::MatrixXd stuck(10, 2);
  stuck.col(0).setConstant(0), stuck.col(1).setConstant(1);
  EXPECT_DOUBLE_EQ(split_r_hat(stuck), 1e6);
  EXPECT_LT(effective_sample_size(stuck), 10);
}

TEST(ChainStatistics, BadDrawsAreRefused) {
  const auto message = [](const Eigen::MatrixXd& draws) {
    try {
      (void)split_r_hat(draws);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message(Eigen::MatrixXd::Zero(3, 2)),
            "chain statistics: 3 draws in 2 chains; at least 4 draws a chain are needed");
  Eigen::MatrixXd draws = Eigen::MatrixXd::Zero(5, 1);
  draws(2, 0) = std::nan("");
  EXPECT_EQ(message(draws), "chain statistics: a draw is not finite");
  EXPECT_THROW((void)effective_sample_size(draws), UsageError);
}

/// Independent normal draws: the deviation's relative error is 1/√(2n).
TEST(ChainStatistics, TheErrorOfADeviation) {
  const Eigen::MatrixXd draws = RandomNumbers(3).normals(5000, 4);
  EXPECT_NEAR(relative_error_of_deviation(draws) * std::sqrt(2 * 20000.0), 1, 0.6);
  EXPECT_GT(relative_error_of_deviation(draws) * std::sqrt(2 * 20000.0), 0.9);
  EXPECT_GT(min_effective_size(draws), 14000);
  // One chain of four that is twice as wide: the halves say so.
  Eigen::MatrixXd uneven = draws;
  uneven.col(3) *= 2;
  EXPECT_GT(relative_error_of_deviation(uneven), 0.1);
}

}  // namespace
}  // namespace knothe::posterior
