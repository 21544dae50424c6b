#include "knothe/posterior/map/samples/map_distribution.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <functional>
#include <numbers>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/map/testing/map_examples.hpp"

namespace knothe::posterior {
namespace {

std::string message_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

struct GaussianCase {
  MapDistribution distribution;
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

GaussianCase gaussian(Eigen::Index d) {
  const AffineMap affine = examples::skew_affine_map(d);
  ComposedMap map(d);
  map.append(affine);
  return {MapDistribution(map), affine.shift, affine.lower * affine.lower.transpose()};
}

TEST(MapDistribution, GaussianPairsAndConditionals) {
  const auto [distribution, mean, covariance] = gaussian(4);
  // z_3, z_4 given z_1, z_2: mean μ_b + C_ba C_aa⁻¹ (z_a − μ_a), covariance C_bb − C_ba C_aa⁻¹ C_ab.
  const Eigen::Vector2d given(0.4, -0.9);
  const Eigen::Matrix2d gain =
      covariance.bottomLeftCorner<2, 2>() * covariance.topLeftCorner<2, 2>().inverse();
  const Eigen::Vector2d conditional_mean = mean.tail<2>() + gain * (given - mean.head<2>());
  const Eigen::Matrix2d conditional_covariance =
      covariance.bottomRightCorner<2, 2>() - gain * covariance.topRightCorner<2, 2>();
  // Density of the marginal of z_1, z_2.
  const Eigen::Vector2d u = given - mean.head<2>();
  const Eigen::Matrix2d marginal = covariance.topLeftCorner<2, 2>();
  EXPECT_NEAR(distribution.leading(2).log_density(given.transpose())[0],
              -0.5 * u.dot(marginal.inverse() * u) - 0.5 * std::log(marginal.determinant()) -
                  std::log(2 * std::numbers::pi),
              1e-10);
  const Eigen::MatrixXd draws =
      distribution.map().evaluate(distribution.conditional_reference(given, 20000, 5));
  EXPECT_LT((draws.leftCols(2).rowwise() - given.transpose()).cwiseAbs().maxCoeff(), 1e-12);
  const numerics::Moments sampled = numerics::moments_of(draws.rightCols(2), Eigen::VectorXd::Ones(20000));
  EXPECT_LT((sampled.mean - conditional_mean).norm(), 0.04);
  EXPECT_LT((sampled.covariance - conditional_covariance).norm(), 0.06);
}

TEST(MapDistribution, BananaInClosedForm) {
  const double b = 0.8;
  const MapDistribution banana(examples::banana_map(b));
  const auto density = [b](double x, double y) {
    return numerics::normal_pdf(x) * numerics::normal_pdf(y - b * x * x);
  };
  const Eigen::MatrixXd z = 1.5 * numerics::monte_carlo_normal_points(10, 2, 1);
  const Eigen::VectorXd log_density = banana.log_density(z);
  for (Eigen::Index i = 0; i < 10; ++i)
    EXPECT_NEAR(log_density[i], std::log(density(z(i, 0), z(i, 1))), 1e-9);
}

TEST(MapDistribution, MistakesAreExplained) {
  const MapDistribution banana(examples::banana_map(0.5));
  EXPECT_NE(message_of([&] { (void)banana.leading(3); }).find("first 3 coordinates of a map with 2"),
            std::string::npos);
  EXPECT_NE(message_of([&] {
              (void)numerics::moments_of(Eigen::MatrixXd::Zero(2, 1), Eigen::VectorXd::Constant(2, -1));
            }).find("not negative"),
            std::string::npos);
}

}  // namespace
}  // namespace knothe::posterior
