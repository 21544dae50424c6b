#include "knothe/transport/extras/map_distribution.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <functional>
#include <numbers>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/sampling/testing/test_targets.hpp"
#include "knothe/transport/diagnose/map_evidence.hpp"
#include "knothe/transport/testing/map_examples.hpp"

namespace knothe::transport {
namespace {

double trapezoid(double a, double b, int n, const std::function<double(double)>& f) {
  double sum = 0.5 * (f(a) + f(b));
  for (int i = 1; i < n; ++i) sum += f(a + (b - a) * i / n);
  return sum * (b - a) / n;
}

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
  const Moments moments = distribution.moments(16384);
  EXPECT_LT((moments.mean - mean).norm(), 1e-12);
  EXPECT_LT((moments.covariance - covariance).norm(), 1e-12);
  EXPECT_LT(moments.skewness.cwiseAbs().maxCoeff(), 0.02);
  EXPECT_LT((moments.kurtosis.array() - 3).abs().maxCoeff(), 0.1);
  const auto mode = distribution.mode();
  EXPECT_TRUE(mode.converged);
  EXPECT_LT((mode.point - mean).norm(), 1e-7);

  const double std = std::sqrt(covariance(2, 2));
  const std::vector<double> at = {mean[2] - 2 * std, mean[2], mean[2] + 0.7 * std};
  const Eigen::VectorXd density = distribution.marginal_density(2, at),
                        cumulative = distribution.marginal_cumulative(2, at);
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double u = (at[static_cast<std::size_t>(i)] - mean[2]) / std;
    EXPECT_NEAR(density[i] * std, numerics::normal_pdf(u), 2e-3);
    EXPECT_NEAR(cumulative[i], numerics::normal_cdf(u), 2e-3);
  }
  const std::vector<double> levels = {0.025, 0.5, 0.9};
  const Eigen::VectorXd quantiles = distribution.marginal_quantiles(3, levels);
  for (Eigen::Index i = 0; i < 3; ++i)
    EXPECT_NEAR((quantiles[i] - mean[3]) / std::sqrt(covariance(3, 3)),
                numerics::normal_quantile(levels[static_cast<std::size_t>(i)]), 0.01);
}

TEST(MapDistribution, GaussianPairsAndConditionals) {
  const auto [distribution, mean, covariance] = gaussian(4);
  const auto pair_density = [&](Eigen::Index k, Eigen::Index l, double a, double b) {
    Eigen::Matrix2d c;
    c << covariance(k, k), covariance(k, l), covariance(l, k), covariance(l, l);
    const Eigen::Vector2d u(a - mean[k], b - mean[l]);
    return std::exp(-0.5 * u.dot(c.inverse() * u)) / (2 * std::numbers::pi * std::sqrt(c.determinant()));
  };
  for (const auto& [k, l] : {std::pair<Eigen::Index, Eigen::Index>{0, 1}, {1, 3}, {3, 1}, {2, 3}}) {
    const std::vector<double> at_k = {mean[k] - 0.5, mean[k] + 1},
                              at_l = {mean[l] - 1, mean[l], mean[l] + 0.8};
    const Eigen::MatrixXd density = distribution.pair_density(k, l, at_k, at_l);
    for (Eigen::Index i = 0; i < 2; ++i)
      for (Eigen::Index j = 0; j < 3; ++j) {
        const double exact =
            pair_density(k, l, at_k[static_cast<std::size_t>(i)], at_l[static_cast<std::size_t>(j)]);
        EXPECT_NEAR(density(i, j) / exact, 1, 0.01) << k << " " << l;
      }
  }
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
  const Moments sampled = moments_of(draws.rightCols(2), Eigen::VectorXd::Ones(20000));
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
  const Moments moments = banana.moments(16384);
  const double variance = 1 + 2 * b * b;
  EXPECT_NEAR(moments.mean[1], b, 1e-10);
  EXPECT_NEAR(moments.covariance(1, 1) / variance, 1, 0.01);
  EXPECT_NEAR(moments.skewness[1] / (8 * b * b * b / std::pow(variance, 1.5)), 1, 0.02);
  EXPECT_NEAR(moments.kurtosis[1] / (3 + 48 * std::pow(b, 4) / (variance * variance)), 1, 0.02);
  // Marginal of z_2 against quadrature; its distribution function and quantiles are consistent with it.
  const std::vector<double> at = {-2, -0.5, 0, 1, 3};
  const Eigen::VectorXd marginal = banana.marginal_density(1, at);
  for (std::size_t i = 0; i < at.size(); ++i) {
    const double exact = trapezoid(-9, 9, 2000, [&](double x) { return density(x, at[i]); });
    EXPECT_NEAR(marginal[static_cast<Eigen::Index>(i)] / exact, 1, 0.01) << at[i];
  }
  const std::vector<double> levels = {0.05, 0.5, 0.975};
  const Eigen::VectorXd quantiles = banana.marginal_quantiles(1, levels);
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const double q = quantiles[static_cast<Eigen::Index>(i)];
    const double below = trapezoid(
        -9, 9, 2000, [&](double x) { return numerics::normal_pdf(x) * numerics::normal_cdf(q - b * x * x); });
    EXPECT_NEAR(below, levels[i], 2e-3);
  }
  const std::vector<double> x = {-1.2, 0.3}, y = {0.1, 2.0};
  const Eigen::MatrixXd pair = banana.pair_density(0, 1, x, y);
  for (Eigen::Index i = 0; i < 2; ++i)
    for (Eigen::Index j = 0; j < 2; ++j)
      EXPECT_NEAR(pair(i, j), density(x[static_cast<std::size_t>(i)], y[static_cast<std::size_t>(j)]), 1e-10);
}

TEST(MapDistribution, MarginalsOfACompositionAgainstDenseQuadrature) {
  ComposedMap map(3);
  map.append(examples::skew_affine_map(3));
  map.append(examples::bent_map(3, 3, 0.12, 4));
  map.append(examples::bent_map(3, 2, 0.1, 5));
  const MapDistribution distribution(map);
  // ∫∫ p(z_1, z_2, z_3) dz_1 dz_2 on a grid.
  const int n = 120;
  Eigen::MatrixXd grid(n * n, 3);
  const double low = -7, step = 14.0 / n;
  for (const double at : {-1.0, 0.6, 2.0}) {
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) grid.row(i * n + j) << low + step * i, low + step * j, at;
    const double exact = distribution.log_density(grid).array().exp().sum() * step * step;
    EXPECT_NEAR(distribution.marginal_density(2, std::span<const double>(&at, 1))[0] / exact, 1, 0.01) << at;
    // The pair (1, 3) integrates to the marginal of 3.
    std::vector<double> first(static_cast<std::size_t>(n));
    for (int i = 0; i < n; ++i) first[static_cast<std::size_t>(i)] = low + step * i;
    MarginalOptions few;
    few.points = 256;
    EXPECT_NEAR(
        distribution.pair_density(0, 2, first, std::span<const double>(&at, 1), few).sum() * step / exact, 1,
        0.02);
  }
}

TEST(MapDistribution, MarginalsOfALazyMapAgainstDenseQuadrature) {
  Eigen::MatrixXd u(3, 1);
  u << 0.6, 0.8 / std::sqrt(2.0), 0.8 / std::sqrt(2.0);
  ComposedMap map(3);
  map.append(examples::skew_affine_map(3));
  map.append(SubspaceMap(u, examples::bent_map(1, 3, 0.3, 6)));
  const MapDistribution distribution(map);
  EXPECT_FALSE(distribution.is_triangular());
  const int n = 120;
  Eigen::MatrixXd grid(n * n, 3);
  const double low = -7, step = 14.0 / n;
  for (const double at : {-0.5, 0.4, 1.5}) {
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) grid.row(i * n + j) << low + step * i, at, low + step * j;
    const double exact = distribution.log_density(grid).array().exp().sum() * step * step;
    EXPECT_NEAR(distribution.marginal_density(1, std::span<const double>(&at, 1))[0] / exact, 1, 0.02) << at;
  }
  EXPECT_NE(message_of([&] { (void)distribution.leading(2); }).find("not triangular"), std::string::npos);
}

TEST(MapDistribution, ModesOfMapAndTarget) {
  // Through an affine map that fits badly the target's own mode is still found.
  sampling::targets::Planar target(sampling::targets::banana(0.6), 1);
  ComposedMap map(2);
  map.append(AffineMap{Eigen::Vector2d(0.3, 0.9), Eigen::Matrix2d{{1.2, 0}, {0.2, 0.7}}});
  const auto mode = MapDistribution(map).mode_of(target);
  EXPECT_LT(mode.point.norm(), 1e-5);
  EXPECT_NEAR(mode.log_density, -std::log(2 * std::numbers::pi), 1e-9);
  // The density of the map is largest where no neighbour is larger.
  ComposedMap bent(2);
  bent.append(examples::bent_map(2, 3, 0.2, 9));
  const MapDistribution distribution(bent);
  const auto top = distribution.mode();
  EXPECT_NEAR(distribution.log_density(top.point.transpose())[0], top.log_density, 1e-9);
  Eigen::MatrixXd around =
      (1e-3 * numerics::monte_carlo_normal_points(200, 2, 2)).rowwise() + top.point.transpose();
  EXPECT_LE(distribution.log_density(around).maxCoeff(), top.log_density + 1e-10);
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

TEST(MapEvidence, BothEstimatesAndTheirErrorBars) {
  sampling::targets::Planar target(sampling::targets::banana(0.6));  // evidence 1
  const auto exact = estimate_evidence(examples::banana_map(0.6), target);
  EXPECT_NEAR(exact.log_evidence, 0, 1e-9);
  EXPECT_NEAR(exact.map_log_evidence, 0, 1e-9);
  EXPECT_NEAR(exact.ess, 1, 1e-9);
  ComposedMap poor(2);  // wide enough to cover
  const double s = 1.3, t = 3.0;
  poor.append(AffineMap{Eigen::Vector2d(0, 0.6), Eigen::Matrix2d{{s, 0}, {0, t}}});
  const auto estimate = estimate_evidence(poor, target);
  EXPECT_GT(estimate.log_evidence_error, 1e-4);
  EXPECT_NEAR(estimate.log_evidence, 0, 4 * estimate.log_evidence_error);
  EXPECT_LT(estimate.log_evidence_error, 0.02);
  // The bound is low by KL(N(m, S)‖banana), in closed form: x = s a, y = 0.6 + t b.
  const double c = 0.6 * s * s, second = 0.36 - 2 * 0.6 * c + 3 * c * c;
  const double divergence = 0.5 * (s * s - 1) - std::log(s) + 0.5 * (t * t + second - 1) - std::log(t);
  EXPECT_NEAR(estimate.map_log_evidence, -divergence, 4 * estimate.map_log_evidence_error + 1e-3);
  EXPECT_LT(estimate.ess, 0.9);
  // Weighted moments are those of the target.
  const WeightedPoints points = weighted_points(poor, target, 16384);
  const Moments moments = moments_of(points.points, normalised_weights(points.log_weight));
  EXPECT_NEAR(moments.mean[1], 0.6, 0.02);
  EXPECT_NEAR(moments.covariance(1, 1), 1 + 0.72, 0.06);
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
  const double at = 0;
  EXPECT_NE(message_of([&] {
              (void)banana.marginal_density(2, std::span<const double>(&at, 1));
            }).find("coordinates 0 to 1"),
            std::string::npos);
  EXPECT_NE(message_of([&] {
              (void)banana.marginal_quantiles(0, std::span<const double>(&at, 1));
            }).find("between 0 and 1"),
            std::string::npos);
  sampling::targets::Gaussian three(Eigen::Vector3d::Zero(), Eigen::Matrix3d::Identity());
  EXPECT_NE(message_of([&] {
              (void)estimate_evidence(banana.map(), three);
            }).find("2 variables for a density in 3"),
            std::string::npos);
  EXPECT_NE(message_of([&] {
              (void)moments_of(Eigen::MatrixXd::Zero(2, 1), Eigen::VectorXd::Constant(2, -1));
            }).find("not negative"),
            std::string::npos);
}

}  // namespace
}  // namespace knothe::transport
