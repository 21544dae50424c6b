#include "knothe/assimilation/forecast/quantity_of_interest.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "knothe/assimilation/forecast/forecast_scores.hpp"
#include "knothe/assimilation/forecast/horizon.hpp"
#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

/// w(p) = (1, p₁, p₂, p₁ p₂).
class Bilinear final : public model::ParameterFunctions {
 public:
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] Eigen::Index count() const override { return 4; }
  [[nodiscard]] Eigen::VectorXd lower() const override { return Eigen::VectorXd::Constant(2, -10); }
  [[nodiscard]] Eigen::VectorXd upper() const override { return Eigen::VectorXd::Constant(2, 10); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& p, int, model::FunctionBatch& out) const override {
    out.value.col(0).setOnes();
    out.value.col(1) = p.col(0);
    out.value.col(2) = p.col(1);
    out.value.col(3) = p.col(0).cwiseProduct(p.col(1));
  }
};

/// A tensor grid of equally probable points of N(mean, diag(std²)).
Eigen::MatrixXd normal_points(int n, Eigen::Vector2d mean, Eigen::Vector2d std) {
  Eigen::MatrixXd points(n * n, 2);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      points(i * n + j, 0) = mean[0] + std[0] * numerics::normal_quantile((i + 0.5) / n);
      points(i * n + j, 1) = mean[1] + std[1] * numerics::normal_quantile((j + 0.5) / n);
    }
  return points;
}

TEST(QuantityOfInterest, LinearInGaussianParameters) {
  const auto functions = std::make_shared<Bilinear>();
  const QuantityOfInterest q(functions, 1.0, Eigen::Vector4d(0.5, 2.0, -1.0, 0.0), 3.0);
  const Eigen::MatrixXd points = normal_points(80, {1.0, 0.5}, {0.1, 0.2});
  const auto f = q.update(points, Eigen::VectorXd::Ones(points.rows()));
  const double mean = 1.5 + 2.0 - 0.5, std = std::hypot(0.2, 0.2);
  EXPECT_NEAR(f.mean, mean, 1e-9);
  EXPECT_NEAR(f.std, std, 1e-2 * std);  // 80 points a direction cut the tails
  EXPECT_NEAR(f.probability_above_threshold, 0.5, 0.01);
  for (std::size_t k = 0; k < k_quantile_levels.size(); ++k)
    EXPECT_NEAR(f.values[k], mean + std * numerics::normal_quantile(k_quantile_levels[k]), 0.03 * std);
}

TEST(QuantityOfInterest, ProductOfIndependentParameters) {
  const QuantityOfInterest q(std::make_shared<Bilinear>(), 0.0, Eigen::Vector4d(0, 0, 0, 1), 100.0);
  const Eigen::MatrixXd points = normal_points(100, {2.0, 3.0}, {0.1, 0.2});
  const auto f = q.update(points, Eigen::VectorXd::Ones(points.rows()));
  EXPECT_NEAR(f.mean, 6.0, 1e-9);
  EXPECT_NEAR(f.std, std::sqrt(9 * 0.01 + 4 * 0.04 + 0.01 * 0.04), 5e-3);
  EXPECT_EQ(f.probability_above_threshold, 0.0);
  model::FunctionBatch batch;
  batch.resize(points.rows(), 2, 4, 0);
  Bilinear().evaluate(points, 0, batch);
  EXPECT_EQ(q.values(batch.value), q.evaluate(points));
}

TEST(QuantityOfInterest, SaysWhatDoesNotFit) {
  EXPECT_THROW(QuantityOfInterest(std::make_shared<Bilinear>(), 0.0, Eigen::Vector3d::Ones(), 0.0),
               DataError);
  EXPECT_THROW(QuantityOfInterest(std::make_shared<Bilinear>(), std::nan(""), Eigen::Vector4d::Ones(), 0.0),
               DataError);
}

TEST(FunctionMoments, WeightedMeanAndCovariance) {
  // Two points with weights 1 and 3; far from zero, so that uncentred sums would lose eight digits.
  model::RowMatrix w(2, 2);
  w << 1e4, 0, 1e4 + 4e-4, 8;
  const auto m = moments_of_functions(w, Eigen::Vector2d(1, 3));
  EXPECT_NEAR(m.mean[0], 1e4 + 3e-4, 1e-11);
  EXPECT_NEAR(m.mean[1], 6.0, 1e-15);
  EXPECT_NEAR(m.covariance(0, 0) / (3.0 / 16 * 16e-8), 1.0, 1e-6);
  EXPECT_NEAR(m.covariance(1, 1), 3.0 / 16 * 64, 1e-13);
  EXPECT_NEAR(m.covariance(0, 1), 3.0 / 16 * 4e-4 * 8, 1e-9);
  EXPECT_EQ(m.covariance(0, 1), m.covariance(1, 0));
  EXPECT_THROW((void)moments_of_functions(w, Eigen::Vector2d(0, 0)), NumericalError);
  EXPECT_THROW((void)moments_of_functions(w, Eigen::Vector2d(2, -1)), NumericalError);
}

TEST(Horizon, OnAndBetweenSteps) {
  const std::vector<double> times = {0.0, 0.1, 0.2, 0.4};
  const auto on = locate_horizon(times, 0.2, "crack");
  EXPECT_EQ(on.lower, 2u);
  EXPECT_EQ(on.upper, 2u);
  EXPECT_EQ(locate_horizon(times, 0.4, "crack").upper, 3u);
  EXPECT_EQ(locate_horizon(times, 0.1 + 1e-9, "crack").lower, 1u);
  EXPECT_EQ(locate_horizon(times, 0.1 + 1e-9, "crack").fraction, 0.0);
  const auto between = locate_horizon(times, 0.25, "crack");
  EXPECT_EQ(between.lower, 2u);
  EXPECT_EQ(between.upper, 3u);
  EXPECT_NEAR(between.fraction, 0.25, 1e-12);
  const LinearPrediction a{Eigen::VectorXd::Constant(2, 1.0), Eigen::MatrixXd::Constant(2, 3, 4.0)};
  const LinearPrediction b{Eigen::VectorXd::Constant(2, 3.0), Eigen::MatrixXd::Constant(2, 3, 8.0)};
  EXPECT_NEAR(interpolate(between, a, b).lift[1], 1.5, 1e-12);
  EXPECT_NEAR(interpolate(between, a, b).modes(0, 2), 5.0, 1e-12);
}

TEST(Horizon, OutsideNamesTheNearestTime) {
  const std::vector<double> times = {0.0, 0.1, 0.2};
  const auto message = [&](double horizon) {
    try {
      (void)locate_horizon(times, horizon, "[forecast.crack] horizon");
    } catch (const ProjectError& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_NE(message(0.3).find("[forecast.crack] horizon = 0.3"), std::string::npos);
  EXPECT_NE(message(0.3).find("the nearest is 0.2"), std::string::npos);
  EXPECT_NE(message(-1).find("the nearest is 0"), std::string::npos);
  EXPECT_NE(message(std::nan("")), "");
}

/// ∫ (F(x) − 1{x ≥ y})² dx by the trapezoidal rule on either side of y.
double crps_by_quadrature(const std::function<double(double)>& cdf, double observed, double reach) {
  const int n = 20000;
  double sum = 0;
  for (const bool above : {false, true}) {
    const double from = above ? observed : observed - reach, h = reach / n;
    for (int i = 0; i <= n; ++i) {
      const double f = cdf(from + i * h) - (above ? 1 : 0);
      sum += (i == 0 || i == n ? 0.5 : 1.0) * h * f * f;
    }
  }
  return sum;
}

TEST(ForecastScores, ClosedFormsAreTheIntegral) {
  for (const double y : {-0.3, 0.4, 2.0}) {
    const Score normal = score_samples(std::array{0.5}, std::array{1.0}, 0.7, y);
    const auto cdf = [](double x) { return numerics::normal_cdf((x - 0.5) / 0.7); };
    EXPECT_NEAR(normal.crps, crps_by_quadrature(cdf, y, 12), 1e-6);
    EXPECT_NEAR(normal.probability, cdf(y), 1e-15);
    const std::vector<double> samples = {0.1, 0.9, -0.4}, weights = {1, 2, 0.5};
    const auto mixture = [&](double x) {
      double sum = 0;
      for (std::size_t i = 0; i < 3; ++i)
        sum += weights[i] / 3.5 * numerics::normal_cdf((x - samples[i]) / 0.2);
      return sum;
    };
    const Score score = score_samples(samples, weights, 0.2, y);
    EXPECT_NEAR(score.crps, crps_by_quadrature(mixture, y, 8), 1e-6);
    EXPECT_NEAR(score.probability, mixture(y), 1e-15);
  }
  // One sample and next to no noise: the absolute error.
  EXPECT_NEAR(score_samples(std::array{1.0}, std::array{1.0}, 1e-9, 3.5).crps, 2.5, 1e-8);
}

}  // namespace
}  // namespace knothe::assimilation
