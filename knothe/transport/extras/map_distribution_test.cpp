#include "knothe/transport/extras/map_distribution.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <functional>
#include <numbers>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/transport/testing/map_examples.hpp"

namespace knothe::transport {
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

TEST(MapDistribution, GaussianInClosedForm) {
  const auto [distribution, mean, covariance] = gaussian(4);
  const numerics::Moments moments = distribution.moments(16384);
  EXPECT_LT((moments.mean - mean).norm(), 1e-12);
  EXPECT_LT((moments.covariance - covariance).norm(), 1e-12);
  EXPECT_LT(moments.skewness.cwiseAbs().maxCoeff(), 0.02);
  EXPECT_LT((moments.kurtosis.array() - 3).abs().maxCoeff(), 0.1);
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
  const Eigen::MatrixXd at = numerics::monte_carlo_normal_points(5, 2, 3);
  const Eigen::VectorXd log_density = distribution.conditional_log_density(given, at);
  for (Eigen::Index i = 0; i < 5; ++i) {
    const Eigen::Vector2d u = at.row(i).transpose() - conditional_mean;
    EXPECT_NEAR(log_density[i],
                -0.5 * u.dot(conditional_covariance.inverse() * u) -
                    0.5 * std::log(conditional_covariance.determinant()) - std::log(2 * std::numbers::pi),
                1e-10);
  }
  const Eigen::MatrixXd draws = distribution.conditional_sample(given, 20000, 5);
  EXPECT_EQ(draws.col(0).minCoeff(), given[0]);
  EXPECT_EQ(draws.col(1).maxCoeff(), given[1]);
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
  const Eigen::VectorXd log_density = banana.log_density(z), conditional = [&] {
    Eigen::VectorXd c(10);
    for (Eigen::Index i = 0; i < 10; ++i)
      c[i] = banana.conditional_log_density(z.row(i).head(1).transpose(), z.row(i).tail(1))[0];
    return c;
  }();
  for (Eigen::Index i = 0; i < 10; ++i) {
    EXPECT_NEAR(log_density[i], std::log(density(z(i, 0), z(i, 1))), 1e-9);
    EXPECT_NEAR(conditional[i], numerics::normal_log_pdf(z(i, 1) - b * z(i, 0) * z(i, 0)), 1e-9);
  }
  // Moments: z_2 = x_2 + b χ².
  const numerics::Moments moments = banana.moments(16384);
  const double variance = 1 + 2 * b * b;
  EXPECT_NEAR(moments.mean[1], b, 1e-10);
  EXPECT_NEAR(moments.covariance(1, 1) / variance, 1, 0.01);
  EXPECT_NEAR(moments.skewness[1] / (8 * b * b * b / std::pow(variance, 1.5)), 1, 0.02);
  EXPECT_NEAR(moments.kurtosis[1] / (3 + 48 * std::pow(b, 4) / (variance * variance)), 1, 0.02);
}

TEST(MapDistribution, SamplesAndQuadratureArePushedForward) {
  const MapDistribution banana(examples::banana_map(0.5));
  const Eigen::MatrixXd draws = banana.sample(1000, 4);
  EXPECT_EQ(draws, banana.sample(1000, 4));
  EXPECT_NE(draws, banana.sample(1000, 5));
  const auto rule = banana.push_forward(numerics::tensor_rule(numerics::gauss_hermite(8), 2));
  EXPECT_NEAR(rule.weights.dot(rule.points.col(1)), 0.5, 1e-12);
  EXPECT_NEAR(rule.weights.dot(rule.points.col(1).cwiseAbs2()), 1 + 3 * 0.25, 1e-10);
}

TEST(MapDistribution, MistakesAreExplained) {
  const MapDistribution banana(examples::banana_map(0.5));
  const std::vector<Eigen::Index> second = {1};
  EXPECT_NE(message_of([&] {
              (void)banana.conditional_sample(second, Eigen::VectorXd::Constant(1, 0.0), 3, 1);
            }).find("put the variables that will be given first"),
            std::string::npos);
  EXPECT_NE(message_of([&] { (void)banana.leading(3); }).find("first 3 coordinates of a map with 2"),
            std::string::npos);
  EXPECT_NE(message_of([&] {
              (void)numerics::moments_of(Eigen::MatrixXd::Zero(2, 1), Eigen::VectorXd::Constant(2, -1));
            }).find("not negative"),
            std::string::npos);
}

}  // namespace
}  // namespace knothe::transport
