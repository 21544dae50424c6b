// Densities and samples whose moments, quantiles and tails have closed forms.
#include "knothe/assimilation/forecast/scalar_forecast.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

std::vector<double> even_points(double low, double high, int intervals) {
  std::vector<double> points;
  for (int i = 0; i <= 2 * intervals; ++i) points.push_back(low + (high - low) * i / (2.0 * intervals));
  return points;
}

ScalarForecast forecast_of(const std::function<double(double)>& log_density, double low, double high,
                           double threshold, int intervals = 158) {
  const auto batch = [&](std::span<const double> x, std::span<double> out) {
    for (std::size_t i = 0; i < x.size(); ++i) out[i] = log_density(x[i]);
  };
  const std::vector<double> base = even_points(low, high, intervals);
  std::vector<double> values(base.size());
  batch(base, values);
  return forecast_of_density(base, values, batch, threshold);
}

double trapezoid(const ScalarForecast& f) {
  double sum = 0.0;
  for (std::size_t i = 0; i + 1 < f.points.size(); ++i)
    sum += 0.5 * (f.density[i] + f.density[i + 1]) * (f.points[i + 1] - f.points[i]);
  return sum;
}

void expect_normal(double mean, double std) {
  SCOPED_TRACE(testing::Message() << "normal " << mean << ", " << std);
  // An unnormalised density with a large constant: only differences count.
  const auto f = forecast_of([&](double x) { return 700.0 - 0.5 * std::pow((x - mean) / std, 2); }, 0.0,
                             0.079, mean + 1.5 * std);
  EXPECT_NEAR(f.mean, mean, 2e-5 * std);
  EXPECT_NEAR(f.std, std, 2e-5 * std);
  EXPECT_NEAR(f.maximum_a_posteriori, mean, 1e-3 * std);
  EXPECT_NEAR(f.probability_above_threshold, numerics::normal_cdf(-1.5), 1e-6);
  for (std::size_t k = 0; k < k_quantile_levels.size(); ++k)
    EXPECT_NEAR(f.values[k], mean + std * numerics::normal_quantile(k_quantile_levels[k]), 1e-4 * std);
  EXPECT_NEAR(trapezoid(f), 1.0, 2e-2);
  double top = 0.0;
  for (double d : f.density) top = std::max(top, d);
  EXPECT_NEAR(top * std * std::sqrt(2 * M_PI), 1.0, 2e-2);
}

TEST(ForecastOfDensity, NormalsOfAnyWidthAnywhere) {
  expect_normal(0.04, 0.005);
  expect_normal(0.0412345, 3e-4);
  expect_normal(0.0412345, 1e-6);  // 1/500 of the first mesh's spacing
  expect_normal(0.04, 1e-8);       // centred on a node
  expect_normal(0.0303030303, 1e-8);
}

TEST(ForecastOfDensity, TruncatedNormalAtTheBorder) {
  // N(0, s²) cut to [0, …]: the half-normal.
  constexpr double s = 2e-4;
  const auto f = forecast_of([](double x) { return -0.5 * x * x / (s * s); }, 0.0, 0.079, 2 * s);
  EXPECT_NEAR(f.mean, s * std::sqrt(2 / M_PI), 2e-5 * s);
  EXPECT_NEAR(f.std, s * std::sqrt(1 - 2 / M_PI), 2e-5 * s);
  EXPECT_NEAR(f.maximum_a_posteriori, 0.0, 1e-3 * s);
  EXPECT_NEAR(f.probability_above_threshold, 2 * numerics::normal_cdf(-2.0), 1e-6);
}

TEST(ForecastOfDensity, ExponentialAgainstAWall) {
  const auto f = forecast_of([](double x) { return 500.0 * x; }, 0.0, 1.0, 0.99);
  EXPECT_NEAR(f.mean, 1.0 - 1.0 / 500, 1e-8);
  EXPECT_NEAR(f.std, 1.0 / 500, 1e-8);
  EXPECT_NEAR(f.probability_above_threshold, 1.0 - std::exp(-5.0), 1e-6);
  EXPECT_EQ(f.maximum_a_posteriori, 1.0);
}

TEST(ForecastOfDensity, TwoPeaksOfVeryDifferentWidth) {
  // Equal masses at 0.02 (wide) and 0.06 (narrow).
  const auto log_density = [](double x) {
    const double a = -0.5 * std::pow((x - 0.02) / 4e-3, 2) - std::log(4e-3);
    const double b = -0.5 * std::pow((x - 0.06) / 5e-5, 2) - std::log(5e-5);
    return std::max(a, b) + std::log1p(std::exp(-std::abs(a - b)));
  };
  const auto f = forecast_of(log_density, 0.0, 0.079, 0.04);
  EXPECT_NEAR(f.mean, 0.04, 1e-6);
  EXPECT_NEAR(f.probability_above_threshold, 0.5, 1e-5);
  EXPECT_NEAR(f.maximum_a_posteriori, 0.06, 1e-7);
}

TEST(ForecastOfDensity, SmallTailProbabilitiesKeepTheirDigits) {
  const auto f = forecast_of([](double x) { return -0.5 * x * x; }, -10.0, 10.0, 6.0);
  EXPECT_NEAR(f.probability_above_threshold / numerics::normal_cdf(-6.0), 1.0, 2e-3);
}

TEST(ForecastOfDensity, ThresholdAtAndBeyondTheEnds) {
  const auto probability = [](double threshold) {
    return forecast_of([](double) { return 0.0; }, 0.0, 1.0, threshold).probability_above_threshold;
  };
  EXPECT_EQ(probability(-1.0), 1.0);
  EXPECT_EQ(probability(0.0), 1.0);
  EXPECT_NEAR(probability(0.25), 0.75, 1e-12);
  EXPECT_EQ(probability(1.0), 0.0);
  EXPECT_EQ(probability(2.0), 0.0);
}

TEST(ForecastOfDensity, ZeroOnPartOfTheRange) {
  const double none = -std::numeric_limits<double>::infinity();
  const auto f = forecast_of([&](double x) { return x < 0.5 ? none : 0.0; }, 0.0, 1.0, 0.6, 8);
  EXPECT_NEAR(f.mean, 0.75, 1e-6);
  EXPECT_NEAR(f.values[2], 0.75, 1e-6);
  EXPECT_THROW((void)forecast_of([&](double) { return none; }, 0.0, 1.0, 0.6), NumericalError);
  EXPECT_THROW((void)forecast_of([](double x) { return std::sqrt(x - 0.5); }, 0.0, 1.0, 0.6), NumericalError);
}

/// Normal samples at evenly spaced probabilities: their weighted statistics converge like 1/n.
Eigen::VectorXd normal_samples(int n, double mean, double std) {
  Eigen::VectorXd x(n);
  for (int i = 0; i < n; ++i) x[(i * 7) % n] = mean + std * numerics::normal_quantile((i + 0.5) / n);
  return x;
}

TEST(ForecastOfSamples, NormalSamples) {
  constexpr int n = 4096;
  const auto f = forecast_of_samples(normal_samples(n, 3.0, 0.2), Eigen::VectorXd::Constant(n, 0.7), 3.3);
  EXPECT_NEAR(f.mean, 3.0, 1e-9);
  EXPECT_NEAR(f.std, 0.2, 2e-4);
  EXPECT_NEAR(f.maximum_a_posteriori, 3.0, 0.01);
  EXPECT_NEAR(f.probability_above_threshold, numerics::normal_cdf(-1.5), 3e-4);
  for (std::size_t k = 0; k < k_quantile_levels.size(); ++k)
    EXPECT_NEAR(f.values[k], 3.0 + 0.2 * numerics::normal_quantile(k_quantile_levels[k]), 2e-3);
  EXPECT_NEAR(trapezoid(f), 1.0, 2e-3);
}

TEST(ForecastOfSamples, WeightsAreImportance) {
  // Uniform samples weighted by a triangle density 2x on [0, 1].
  constexpr int n = 5000;
  Eigen::VectorXd x(n);
  for (int i = 0; i < n; ++i) x[i] = (i + 0.5) / n;
  const auto f = forecast_of_samples(x, x, 0.5);
  EXPECT_NEAR(f.mean, 2.0 / 3, 1e-6);
  EXPECT_NEAR(f.std, std::sqrt(1.0 / 18), 1e-6);
  EXPECT_NEAR(f.probability_above_threshold, 0.75, 1e-4);
  for (std::size_t k = 0; k < k_quantile_levels.size(); ++k)
    EXPECT_NEAR(f.values[k], std::sqrt(k_quantile_levels[k]), 1e-4);
}

TEST(ForecastOfSamples, EqualSamplesStayFinite) {
  const auto f = forecast_of_samples(Eigen::VectorXd::Constant(10, 2.5), Eigen::VectorXd::Ones(10), 2.5);
  EXPECT_EQ(f.mean, 2.5);
  EXPECT_EQ(f.std, 0.0);
  EXPECT_NEAR(f.maximum_a_posteriori, 2.5, 1e-8);
  EXPECT_EQ(f.probability_above_threshold, 0.0);
  for (double d : f.density) EXPECT_TRUE(std::isfinite(d));
  for (double v : f.values) EXPECT_EQ(v, 2.5);
}

TEST(ForecastOfSamples, AnErrorOfTheModelIsAddedToTheSamples) {
  // Two samples of unequal weight: a mixture of two normal distributions, whose quantiles solve
  // ¼ Φ((q − 1)/s) + ¾ Φ((q − 2)/s) = level.
  const Eigen::Vector2d x(1.0, 2.0), w(1.0, 3.0);
  constexpr double s = 0.4, threshold = 1.7;
  const auto f = forecast_of_samples(x, w, threshold, s);
  const auto below = [&](double q) {
    return 0.25 * numerics::normal_cdf((q - 1) / s) + 0.75 * numerics::normal_cdf((q - 2) / s);
  };
  EXPECT_DOUBLE_EQ(f.mean, 1.75);
  EXPECT_NEAR(f.std, std::sqrt(0.1875 + s * s), 1e-12);
  for (std::size_t k = 0; k < k_quantile_levels.size(); ++k)
    EXPECT_NEAR(below(f.values[k]), k_quantile_levels[k], 1e-9);
  EXPECT_NEAR(f.probability_above_threshold, 1 - below(threshold), 1e-12);
  EXPECT_NEAR(trapezoid(f), 1.0, 2e-2);
}

TEST(ForecastOfSamples, NormalSamplesWithAnErrorAreNormal) {
  const int n = 4000;
  const auto f = forecast_of_samples(normal_samples(n, 3.0, 0.2), Eigen::VectorXd::Ones(n), 3.5, 0.15);
  EXPECT_NEAR(f.std, 0.25, 1e-3);
  EXPECT_NEAR(f.maximum_a_posteriori, 3.0, 0.01);
  EXPECT_NEAR(f.probability_above_threshold, numerics::normal_cdf(-2.0), 1e-3);
  for (std::size_t k = 0; k < k_quantile_levels.size(); ++k)
    EXPECT_NEAR(f.values[k], 3.0 + 0.25 * numerics::normal_quantile(k_quantile_levels[k]), 2e-3);
}

TEST(ForecastOfSamples, RefusesAnErrorThatIsNone) {
  const Eigen::VectorXd x = Eigen::VectorXd::Ones(3);
  EXPECT_THROW((void)forecast_of_samples(x, x, 0.0, -1.0), NumericalError);
  EXPECT_THROW((void)forecast_of_samples(x, x, 0.0, std::nan("")), NumericalError);
}

TEST(ForecastOfSamples, RefusesWhatItCannotUse) {
  Eigen::VectorXd x = Eigen::VectorXd::Ones(3), w = Eigen::VectorXd::Zero(3);
  EXPECT_THROW((void)forecast_of_samples(x, w, 0.0), NumericalError);
  w.setOnes();
  x[1] = std::nan("");
  EXPECT_THROW((void)forecast_of_samples(x, w, 0.0), NumericalError);
}

}  // namespace
}  // namespace knothe::assimilation
