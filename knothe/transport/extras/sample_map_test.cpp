#include "knothe/transport/extras/sample_map.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/transport/extras/sample_objective.hpp"

namespace knothe::transport {
namespace {

MapFamily family_of(Rectifier rectifier) {
  return [rectifier](Eigen::Index d, int order) {
    Parametrisation p;
    p.rectifier = rectifier;
    return total_order_map(d, order, p);
  };
}

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
  for (const Rectifier rectifier : {Rectifier::square, Rectifier::softplus, Rectifier::exponential}) {
    const TriangularMap map(family_of(rectifier)(3, 3));
    SampleObjective objective(map, 2, y, 0.01);
    const Eigen::Index m = objective.dimension();
    Eigen::VectorXd a = objective.affine_start();
    a += 0.02 * numerics::monte_carlo_normal_points(m, 1, 2);
    double value = 0, up = 0, down = 0;
    Eigen::VectorXd gradient(m), gradient_up(m), gradient_down(m);
    Eigen::MatrixXd hessian(m, m), unused;
    ASSERT_TRUE(objective.evaluate(a, 2, value, gradient, hessian)) << to_string(rectifier);
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
}

TEST(SampleMap, AGaussianIsItsMeanAndCovariance) {
  Eigen::MatrixXd z = numerics::monte_carlo_normal_points(500, 3, 3);
  z.col(2) = (0.3 * z.col(2) + 0.8 * z.col(0) - 0.4 * z.col(1)).eval();
  z.col(1) = (z.col(1).array() * 5 + 10).eval();
  const numerics::Moments moments = numerics::moments_of(z, Eigen::VectorXd::Ones(500));
  for (const auto standardisation : {Standardisation::diagonal, Standardisation::whitening}) {
    SampleMapOptions options;
    options.family = family_of(Rectifier::square);
    options.max_order = 1;
    options.folds = 0;
    options.standardisation = standardisation;
    const SampleMap map = map_from_samples(z, {}, options);
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
    EXPECT_NEAR(map.log_likelihood, map.log_density(z).mean(), 1e-9);
  }
}

TEST(SampleMap, BananaForEveryRectifier) {
  const Eigen::MatrixXd z = banana_samples(2000, 0.5, 0.5, 5), test = banana_samples(4000, 0.5, 0.5, 6);
  const double truth = banana_log_density(test, 0.5, 0.5).mean();
  for (const Rectifier rectifier : {Rectifier::square, Rectifier::softplus, Rectifier::exponential}) {
    SampleMapOptions options;
    options.family = family_of(rectifier);
    options.max_order = 4;
    const SampleMap map = map_from_samples(z, {}, options);
    EXPECT_TRUE(map.converged) << to_string(rectifier) << map.reason;
    EXPECT_GE(map.orders[1], 2) << to_string(rectifier);
    // KL(truth‖map), on samples not used: about (number of coefficients)/(2 n).
    const double divergence = truth - map.log_density(test).mean();
    EXPECT_LT(divergence, 0.02) << to_string(rectifier);
    EXPECT_NEAR(map.held_out_log_likelihood, truth, 0.06) << to_string(rectifier);
    EXPECT_GT(map.held_out_error, 0.01);
    // Given x = 1: N(0.5, 0.25).
    const Eigen::VectorXd given = Eigen::VectorXd::Constant(1, 1.0);
    const Eigen::MatrixXd draws = map.conditional_sample(given, 4000, 7);
    EXPECT_EQ(draws.col(0).maxCoeff(), 1.0);
    EXPECT_NEAR(draws.col(1).mean(), 0.5, 0.07);
    EXPECT_NEAR(std::sqrt((draws.col(1).array() - draws.col(1).mean()).square().mean()), 0.5, 0.06);
    const Eigen::MatrixXd at = Eigen::MatrixXd::Constant(1, 1, 0.7);
    EXPECT_NEAR(map.conditional_log_density(given, at)[0],
                numerics::normal_log_pdf(0.2 / 0.5) - std::log(0.5), 0.15);
    const numerics::Moments again = numerics::moments_of(map.sample(4000, 8), Eigen::VectorXd::Ones(4000));
    EXPECT_NEAR(again.mean[1], 0.5, 0.07);
  }
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
  const double low = map_from_samples(z, {}, options).log_density(test).mean();
  options.max_order = 8;
  options.folds = 3;
  const SampleMap map = map_from_samples(z, {}, options);
  EXPECT_GE(map.orders[0], 4);
  EXPECT_LT(truth - map.log_density(test).mean(), 0.04);
  EXPECT_GT(truth - low, 0.1);
}

TEST(SampleMap, AChainNeedsFewCoefficients) {
  // x_k ~ N(0.6 x_{k−1} + 0.2 x_{k−1}², 0.7²): each variable depends on the one before it alone.
  const Eigen::Index d = 10;
  const auto chain = [d](Eigen::Index n, std::uint64_t seed) {
    Eigen::MatrixXd z = numerics::monte_carlo_normal_points(n, d, seed);
    for (Eigen::Index k = 1; k < d; ++k)
      z.col(k) = (0.7 * z.col(k).array() + 0.6 * z.col(k - 1).array() + 0.2 * z.col(k - 1).array().sin())
                     .matrix()
                     .eval();
    return z;
  };
  const Eigen::MatrixXd z = chain(3000, 30), test = chain(3000, 40);
  std::vector<std::pair<int, int>> edges;
  for (int k = 1; k < d; ++k) edges.emplace_back(k - 1, k);
  const Parents parents = parents_by_elimination(d, edges);
  SampleMapOptions options;
  options.min_order = options.max_order = 2;
  options.folds = 0;
  const SampleMap full = map_from_samples(z, {}, options);
  options.family = [parents](Eigen::Index dimension, int order) {
    Parametrisation p;
    p.rectifier = Rectifier::softplus;
    return sparse_map(total_order_map(dimension, order, p), parents);
  };
  const SampleMap sparse = map_from_samples(z, {}, options);
  EXPECT_LT(4 * sparse.coefficient_count, full.coefficient_count);
  double truth = 0;
  for (Eigen::Index k = 0; k < d; ++k)
    for (Eigen::Index i = 0; i < test.rows(); ++i)
      truth += (k == 0 ? numerics::normal_log_pdf(test(i, 0))
                       : numerics::normal_log_pdf(
                             (test(i, k) - 0.6 * test(i, k - 1) - 0.2 * std::sin(test(i, k - 1))) / 0.7) -
                             std::log(0.7)) /
               static_cast<double>(test.rows());
  const double sparse_loss = truth - sparse.log_density(test).mean(),
               full_loss = truth - full.log_density(test).mean();
  EXPECT_LT(sparse_loss, 0.05);
  EXPECT_LT(full_loss, 0.25);
  EXPECT_LT(sparse_loss, full_loss);  // what is not there need not be estimated
}

TEST(SampleMap, AWeightIsARepeatedSample) {
  const Eigen::MatrixXd z = banana_samples(300, 0.4, 0.6, 50);
  Eigen::VectorXd weights = Eigen::VectorXd::Ones(300);
  Eigen::MatrixXd repeated(400, 2);
  repeated.topRows(300) = z;
  repeated.bottomRows(100) = z.topRows(100);
  weights.head(100).setConstant(2);
  SampleMapOptions options;
  options.max_order = 3;
  options.folds = 0;
  const SampleMap a = map_from_samples(z, weights, options), b = map_from_samples(repeated, {}, options);
  const Eigen::MatrixXd at = numerics::monte_carlo_normal_points(20, 2, 51);
  EXPECT_LT((a.log_density(at) - b.log_density(at)).cwiseAbs().maxCoeff(), 1e-5);
}

TEST(SampleMap, MistakesAreExplained) {
  const auto message = [](const Eigen::MatrixXd& z, const Eigen::VectorXd& w,
                          const SampleMapOptions& options) {
    try {
      (void)map_from_samples(z, w, options);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  Eigen::MatrixXd z = banana_samples(50, 0.4, 0.6, 60);
  SampleMapOptions options;
  EXPECT_NE(message(z, Eigen::VectorXd::Ones(3), options).find("50 samples, 3 weights"), std::string::npos);
  options.max_order = 0;
  EXPECT_NE(message(z, {}, options).find("orders 1 to 0"), std::string::npos);
  options = {};
  options.folds = 1;
  EXPECT_NE(message(z, {}, options).find("1 folds"), std::string::npos);
  options = {};
  z(7, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(message(z, {}, options).find("sample 7, coordinate 1 is nan"), std::string::npos);
  z.col(1).setConstant(3);
  EXPECT_NE(message(z, {}, options).find("coordinate 1 has no spread"), std::string::npos);
  z.col(1) = 2 * z.col(0);
  EXPECT_NE(message(z, {}, options).find("covariance of the samples is singular"), std::string::npos);
  options.folds = 0;
  EXPECT_NE(
      message(banana_samples(10, 0.4, 0.6, 60), {}, options).find("coefficients, but there are 10 samples"),
      std::string::npos);
}

}  // namespace
}  // namespace knothe::transport
