#include "knothe/numerics/statistics/distinct_draws.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::numerics {
namespace {

constexpr double k_infinity = std::numeric_limits<double>::infinity();

std::size_t distinct_rows(const Eigen::MatrixXd& draws) {
  std::set<std::vector<double>> rows;
  for (Eigen::Index i = 0; i < draws.rows(); ++i) rows.emplace(draws.row(i).begin(), draws.row(i).end());
  return rows.size();
}

TEST(DistinctDraws, AreThePointsThemselvesWhereNoneIsDrawnTwice) {
  const Eigen::MatrixXd points = monte_carlo_normal_points(1000, 2, 3);
  const Eigen::VectorXd weights = Eigen::VectorXd::Constant(1000, 1e-3),
                        none = Eigen::Vector2d(k_infinity, k_infinity);
  const auto sorted = [](Eigen::MatrixXd m) {
    std::vector<std::vector<double>> rows;
    for (Eigen::Index i = 0; i < m.rows(); ++i) rows.emplace_back(m.row(i).begin(), m.row(i).end());
    std::sort(rows.begin(), rows.end());
    return rows;
  };
  const Eigen::MatrixXd draws = distinct_draws(points, weights, 500, -none, none);
  EXPECT_EQ(sorted(draws), sorted(points(equal_draws(weights, 500), Eigen::all)));
}

TEST(DistinctDraws, AreInRandomOrder) {
  // Points in the order of their first coordinate: draws that follow each other must not be alike.
  Eigen::MatrixXd points = monte_carlo_normal_points(1000, 1, 3);
  std::sort(points.data(), points.data() + points.size());
  const Eigen::VectorXd none = Eigen::VectorXd::Constant(1, k_infinity);
  for (const Eigen::Index count : {500, 4000}) {
    const Eigen::VectorXd x = distinct_draws(points, Eigen::VectorXd::Ones(1000), count, -none, none).col(0);
    const double mean = x.mean(), variance = (x.array() - mean).square().mean();
    const double product = ((x.head(count - 1).array() - mean) * (x.tail(count - 1).array() - mean)).mean();
    EXPECT_LT(std::abs(product), 4 / std::sqrt(static_cast<double>(count)) * variance);
  }
}

TEST(DistinctDraws, OfALatticeFillItsCells) {
  // A correlated normal density on 15 × 61 nodes: the draws have as many values of each variable as there
  // are draws, and its marginal distribution.
  Eigen::MatrixXd points(15 * 61, 2);
  Eigen::VectorXd weights(points.rows());
  for (Eigen::Index i = 0; i < 15; ++i)
    for (Eigen::Index j = 0; j < 61; ++j) {
      const double x = -3.5 + 0.5 * static_cast<double>(i), z = -4 + 8.0 / 60 * static_cast<double>(j);
      points.row(61 * i + j) << x, z;
      weights[61 * i + j] = std::exp(-0.5 * (x * x - 2 * 0.6 * x * z + z * z) / (1 - 0.36));
    }
  const Eigen::Vector2d none(k_infinity, k_infinity);
  const Eigen::MatrixXd draws = distinct_draws(points, weights, 4000, -none, none);
  for (Eigen::Index k = 0; k < 2; ++k) {
    std::vector<double> values(draws.col(k).begin(), draws.col(k).end());
    std::sort(values.begin(), values.end());
    EXPECT_EQ(std::unique(values.begin(), values.end()) - values.begin(), 4000);
    double distance = 0;  // of Kolmogorov and Smirnov; 0.026 at a probability of 0.01
    for (std::size_t i = 0; i < values.size(); ++i)
      distance = std::max(distance, std::abs(normal_cdf(values[i]) - (static_cast<double>(i) + 0.5) / 4000));
    EXPECT_LT(distance, 0.026) << k;
  }
  const Moments found = moments_of(draws, Eigen::VectorXd::Ones(4000));
  EXPECT_NEAR(found.covariance(0, 1), 0.6, 0.02);
  EXPECT_NEAR(found.covariance(0, 0), 1, 0.05);
}

TEST(DistinctDraws, KeepMeanAndCovarianceOfFewPoints) {
  // Weights of a shifted and narrowed normal distribution, whose moments are known: N((0.5, 0), I / 2).
  const Eigen::MatrixXd points = monte_carlo_normal_points(3000, 2, 5);
  Eigen::VectorXd weights(points.rows());
  for (Eigen::Index i = 0; i < points.rows(); ++i)
    weights[i] = std::exp(-(points.row(i) - Eigen::RowVector2d(0.5, 0)).squaredNorm() +
                          0.5 * points.row(i).squaredNorm());
  const Eigen::Vector2d none(k_infinity, k_infinity);
  const Eigen::MatrixXd draws = distinct_draws(points, weights, 20000, -none, none);
  EXPECT_EQ(distinct_rows(draws), 20000u);
  const Moments expected = moments_of(points, weights);
  const Moments found = moments_of(draws, Eigen::VectorXd::Ones(draws.rows()));
  EXPECT_LT((found.mean - expected.mean).norm(), 0.02);
  EXPECT_LT((found.covariance - expected.covariance).norm(), 0.02);
  EXPECT_LT((found.mean - Eigen::Vector2d(0.5, 0)).norm(), 0.1);
}

TEST(DistinctDraws, StayInTheirModeAndOnItsCurve) {
  // Two arcs of radius 1, 10 apart, as thin as 0.01: a kernel of the whole covariance would fill the plane.
  Eigen::MatrixXd points(1000, 2);
  const Eigen::MatrixXd u = monte_carlo_points(1000, 2, 9);
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    const double angle = 3 * u(i, 0), radius = 1 + 0.01 * u(i, 1);
    points.row(i) << (i % 2 == 0 ? -5 : 5) + radius * std::cos(angle), radius * std::sin(angle);
  }
  const Eigen::Vector2d none(k_infinity, k_infinity);
  const Eigen::MatrixXd draws = distinct_draws(points, Eigen::VectorXd::Ones(1000), 10000, -none, none);
  EXPECT_EQ(distinct_rows(draws), 10000u);
  for (Eigen::Index i = 0; i < draws.rows(); ++i)
    EXPECT_NEAR(std::hypot(draws(i, 0) - (draws(i, 0) < 0 ? -5 : 5), draws(i, 1)), 1.005, 0.06) << i;
}

TEST(DistinctDraws, DoNotDependOnUnits) {
  // Pascals beside a number of two narrow modes: the same draws as in units of one.
  Eigen::MatrixXd points = monte_carlo_normal_points(1000, 2, 9);
  for (Eigen::Index i = 0; i < points.rows(); ++i) points(i, 1) = (i % 2 == 0 ? -1 : 1) + 0.02 * points(i, 1);
  const Eigen::Vector2d none(k_infinity, k_infinity);
  const Eigen::VectorXd weights = Eigen::VectorXd::Ones(1000);
  const Eigen::MatrixXd expected = distinct_draws(points, weights, 5000, -none, none);
  const Eigen::Vector2d units(1e10, 1e-2);
  const Eigen::MatrixXd draws = distinct_draws(points * units.asDiagonal(), weights, 5000, -none, none);
  for (Eigen::Index k = 0; k < 2; ++k)
    EXPECT_LT((draws.col(k) / units[k] - expected.col(k)).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_GT(expected.col(1).cwiseAbs().minCoeff(), 0.8);
}

TEST(DistinctDraws, OfALatticeStayInTheirMode) {
  // 61 × 61 nodes, all mass within half a spacing of x = ±1: cells are those of the lattice, not of the
  // draws.
  Eigen::MatrixXd points(61 * 61, 2);
  Eigen::VectorXd weights(points.rows());
  for (Eigen::Index i = 0; i < 61; ++i)
    for (Eigen::Index j = 0; j < 61; ++j) {
      const double x = -3 + 0.1 * static_cast<double>(i), z = -3 + 0.1 * static_cast<double>(j);
      points.row(61 * i + j) << x, z;
      weights[61 * i + j] = std::exp(-0.5 * std::pow((std::abs(x) - 1) / 0.01, 2) - 0.5 * z * z);
    }
  const Eigen::Vector2d none(k_infinity, k_infinity);
  const Eigen::MatrixXd draws = distinct_draws(points, weights, 2000, -none, none);
  EXPECT_LT((draws.col(0).cwiseAbs().array() - 1).abs().maxCoeff(), 0.0501);
}

TEST(DistinctDraws, StayInTheSupport) {
  const Eigen::MatrixXd points = monte_carlo_points(50, 3, 7);
  const Eigen::VectorXd lower = Eigen::VectorXd::Zero(3), upper = Eigen::VectorXd::Ones(3);
  const Eigen::MatrixXd draws = distinct_draws(points, Eigen::VectorXd::Ones(50), 2000, lower, upper);
  EXPECT_EQ(distinct_rows(draws), 2000u);
  EXPECT_GE(draws.minCoeff(), 0);
  EXPECT_LE(draws.maxCoeff(), 1);
}

}  // namespace
}  // namespace knothe::numerics
