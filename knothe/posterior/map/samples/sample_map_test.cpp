#include "knothe/posterior/map/samples/sample_map.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/map/samples/sample_objective.hpp"

namespace knothe::posterior {
namespace {

/// x ~ N(0, 1), y ~ N(b x², s²).
Eigen::MatrixXd banana_samples(Eigen::Index n, double b, double s, std::uint64_t seed) {
  Eigen::MatrixXd z = numerics::monte_carlo_normal_points(n, 2, seed);
  z.col(1) = (s * z.col(1).array() + b * z.col(0).array().square()).matrix().eval();
  return z;
}
Eigen::VectorXd banana_log_density(const Eigen::MatrixXd& z, double b, double s) {
  return -0.5 * z.col(0).array().square() -
         0.5 * ((z.col(1).array() - b * z.col(0).array().square()) / s).square() -
         std::log(2 * std::numbers::pi * s);
}

TEST(SampleObjective, DerivativesAgainstDifferences) {
  const Eigen::MatrixXd y = 1.3 * numerics::monte_carlo_normal_points(40, 3, 1);
  const TriangularMap map(total_order_map(3, 3, {Rectifier::softplus, {}}));
  SampleObjective objective(map, 2, y, 0.01);
  const Eigen::Index m = objective.dimension();
  Eigen::VectorXd a = objective.affine_start();
  a += 0.02 * numerics::monte_carlo_normal_points(m, 1, 2);
  double value = 0, up = 0, down = 0;
  Eigen::VectorXd gradient(m), gradient_up(m), gradient_down(m);
  Eigen::MatrixXd hessian(m, m), unused;
  ASSERT_TRUE(objective.evaluate(a, 2, value, gradient, hessian));
  // The value, by the map itself.
  TriangularMap with_a = map;
  Eigen::VectorXd all = map.coefficients();
  all.tail(m) = a;
  with_a.set_coefficients(all);
  const Eigen::VectorXd losses = objective.losses(a);
  const Eigen::MatrixXd image = with_a.evaluate(y);
  MapBatch batch;
  with_a.evaluate(y, 1, batch);
  for (Eigen::Index i = 0; i < 40; ++i)
    EXPECT_NEAR(losses[i], 0.5 * image(i, 2) * image(i, 2) - std::log(batch.jacobian(i, 8)), 1e-9);
  for (Eigen::Index j = 0; j < m; ++j) {
    const double step = 1e-5, here = a[j];
    a[j] = here + step;
    objective.evaluate(a, 1, up, gradient_up, unused);
    a[j] = here - step;
    objective.evaluate(a, 1, down, gradient_down, unused);
    a[j] = here;
    EXPECT_NEAR((up - down) / (2 * step), gradient[j], 1e-6 * (1 + std::abs(gradient[j])));
    EXPECT_LT(((gradient_up - gradient_down) / (2 * step) - hessian.col(j)).cwiseAbs().maxCoeff(),
              1e-5 * (1 + hessian.col(j).cwiseAbs().maxCoeff()));
  }
}

TEST(SampleMap, AGaussianIsItsMeanAndCovariance) {
  Eigen::MatrixXd z = numerics::monte_carlo_normal_points(500, 3, 3);
  z.col(2) = (0.3 * z.col(2) + 0.8 * z.col(0) - 0.4 * z.col(1)).eval();
  z.col(1) = (z.col(1).array() * 5 + 10).eval();
  const numerics::Moments moments = numerics::moments_of(z, Eigen::VectorXd::Ones(500));
  SampleMapOptions options;
  options.max_order = 1;
  options.folds = 0;
  const SampleMap map = map_from_samples(z, options);
  EXPECT_TRUE(map.converged) << map.reason;
  // Maximum likelihood: the log density is that of N(mean, covariance) of the samples.
  const Eigen::MatrixXd at = 2 * numerics::monte_carlo_normal_points(5, 3, 4);
  const Eigen::VectorXd log_density = map.log_density(at);
  const Eigen::Matrix3d c = moments.covariance;
  for (Eigen::Index i = 0; i < 5; ++i) {
    const Eigen::Vector3d u = at.row(i).transpose() - moments.mean;
    EXPECT_NEAR(log_density[i],
                -0.5 * u.dot(c.inverse() * u) - 0.5 * std::log(c.determinant()) -
                    1.5 * std::log(2 * std::numbers::pi),
                1e-6 * (1 + std::abs(log_density[i])));
  }
}

TEST(SampleMap, ABananaAndItsConditional) {
  const Eigen::MatrixXd z = banana_samples(2000, 0.5, 0.5, 5), test = banana_samples(4000, 0.5, 0.5, 6);
  const double truth = banana_log_density(test, 0.5, 0.5).mean();
  SampleMapOptions options;
  options.max_order = 4;
  const SampleMap map = map_from_samples(z, options);
  EXPECT_TRUE(map.converged) << map.reason;
  EXPECT_GE(map.orders[1], 2);
  // KL(truth‖map), on samples not used: about (number of coefficients)/(2 n).
  const double divergence = truth - map.log_density(test).mean();
  EXPECT_LT(divergence, 0.02);
  // Given x = 1: N(0.5, 0.25).
  const Eigen::VectorXd given = Eigen::VectorXd::Constant(1, 1.0);
  const Eigen::MatrixXd draws = map.map.inverse(map.conditional_reference(given, 4000, 7));
  EXPECT_LT((draws.col(0).array() - 1.0).abs().maxCoeff(), 1e-10);
  EXPECT_NEAR(draws.col(1).mean(), 0.5, 0.07);
  EXPECT_NEAR(std::sqrt((draws.col(1).array() - draws.col(1).mean()).square().mean()), 0.5, 0.06);
  const numerics::Moments again = numerics::moments_of(
      map.map.inverse(map.conditional_reference({}, 4000, 8)), Eigen::VectorXd::Ones(4000));
  EXPECT_NEAR(again.mean[1], 0.5, 0.07);
}

TEST(SampleMap, ASkewTwoHumpedDensity) {
  // 0.35 N(−1.5, 0.5²) + 0.65 N(1.5, 0.8²): the map has to bend; KL to the truth falls with the order.
  const Eigen::Index n = 1500;
  const auto draw = [](Eigen::Index count, std::uint64_t seed) {
    const Eigen::VectorXd u = numerics::monte_carlo_points(count, 1, seed);
    Eigen::MatrixXd z = numerics::monte_carlo_normal_points(count, 1, seed + 1);
    for (Eigen::Index i = 0; i < count; ++i)
      z(i, 0) = u[i] < 0.35 ? -1.5 + 0.5 * z(i, 0) : 1.5 + 0.8 * z(i, 0);
    return z;
  };
  const Eigen::MatrixXd z = draw(n, 10), test = draw(n, 20);
  double truth = 0;
  for (Eigen::Index i = 0; i < n; ++i)
    truth += std::log(0.35 / 0.5 * numerics::normal_pdf((test(i, 0) + 1.5) / 0.5) +
                      0.65 / 0.8 * numerics::normal_pdf((test(i, 0) - 1.5) / 0.8)) /
             static_cast<double>(n);
  SampleMapOptions options;
  options.max_order = 1;
  const double low = map_from_samples(z, options).log_density(test).mean();
  options.max_order = 8;
  options.folds = 3;
  const SampleMap map = map_from_samples(z, options);
  EXPECT_GE(map.orders[0], 4);
  EXPECT_LT(truth - map.log_density(test).mean(), 0.04);
  EXPECT_GT(truth - low, 0.1);
}

TEST(SampleMap, MistakesAreExplained) {
  const auto message = [](const Eigen::MatrixXd& z, const SampleMapOptions& options) {
    try {
      (void)map_from_samples(z, options);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  Eigen::MatrixXd z = banana_samples(50, 0.4, 0.6, 60);
  SampleMapOptions options;
  options.max_order = 0;
  EXPECT_NE(message(z, options).find("orders 1 to 0"), std::string::npos);
  options = {};
  options.folds = 1;
  EXPECT_NE(message(z, options).find("1 folds"), std::string::npos);
  options = {};
  z(7, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(message(z, options).find("sample 7, coordinate 1 is nan"), std::string::npos);
  z.col(1).setConstant(3);
  EXPECT_NE(message(z, options).find("coordinate 1 has no spread"), std::string::npos);
  z.col(1) = 2 * z.col(0);
  EXPECT_NE(message(z, options).find("covariance of the samples is singular"), std::string::npos);
  options.folds = 0;
  EXPECT_NE(message(banana_samples(10, 0.4, 0.6, 60), options).find("coefficients, but there are 10 samples"),
            std::string::npos);
}

}  // namespace
}  // namespace knothe::posterior
