#include "knothe/numerics/statistics/distinct_draws.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

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
  EXPECT_EQ(distinct_draws(points, weights, 500, -none, none), points(equal_draws(weights, 500), Eigen::all));
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
