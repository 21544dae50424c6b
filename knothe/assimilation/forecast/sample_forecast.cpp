#include <algorithm>
#include <boost/math/tools/toms748_solve.hpp>
#include <cmath>
#include <cstdint>
#include <utility>

#include "knothe/assimilation/forecast/scalar_forecast.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/statistics/kernel_density.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::assimilation {
namespace {

void check(const Eigen::Ref<const Eigen::VectorXd>& values,
           const Eigen::Ref<const Eigen::VectorXd>& weights) {
  const double total = weights.sum();
  if (values.size() == 0 || values.size() != weights.size() || !(total > 0.0) || !std::isfinite(total) ||
      weights.minCoeff() < 0.0 || !values.allFinite())
    throw NumericalError("forecast: samples must be finite, their weights non-negative with a positive sum");
}

std::vector<double> even_points(double low, double high, int count) {
  std::vector<double> points;
  for (int k = 0; k < count; ++k) points.push_back(low + (high - low) * k / (count - 1.0));
  return points;
}

/// Many samples as few: their weights shared out linearly over even points, an eighth of the error apart. The
/// mean stays; the variance that this adds is taken from the error's.
struct Binned {
  std::vector<double> points, weights;
  double kernel_std;
};
Binned bin(std::span<const double> x, std::span<const double> w, double low, double high, double width) {
  const int bins = static_cast<int>(std::clamp(8 * (high - low) / width, 1.0, 1024.0)) + 1;
  Binned binned{even_points(low, high, bins), std::vector<double>(bins, 0.0), 0};
  const double scale = high > low ? (bins - 1) / (high - low) : 0.0;
  double total = 0, spread = 0;
  for (Index i = 0; i < std::ssize(x); ++i) {
    const double place = (x[i] - low) * scale;
    const int left = std::min<int>(place, bins - 2);
    const double share = std::clamp(place - left, 0.0, 1.0);  // rounding
    binned.weights[left] += (1 - share) * w[i];
    binned.weights[left + 1] += share * w[i];
    total += w[i], spread += w[i] * share * (1 - share);
  }
  const double added = scale > 0 ? spread / (total * scale * scale) : 0;
  binned.kernel_std = std::sqrt(std::max(width * width - added, 0.25 * width * width));
  return binned;
}

/// P(x + e ≤ value), of samples that share a weight of `total` and errors e of the kernel.
double probability_below(double value, const Binned& samples, double total) {
  double sum = 0.0;
  for (Index i = 0; i < std::ssize(samples.points); ++i) {
    if (samples.weights[i] > 0.0)
      sum += samples.weights[i] * numerics::normal_cdf((value - samples.points[i]) / samples.kernel_std);
  }
  return std::clamp(sum / total, 0.0, 1.0);
}

/// Standard deviation, quantiles and probability of the samples plus an error N(0, std²).
void add_error(const Binned& samples, double total, double std, double threshold, ScalarForecast& forecast) {
  constexpr double k_tails = 9.0;
  forecast.std = std::hypot(forecast.std, std);
  for (Index k = 0; k < std::ssize(k_quantile_levels); ++k) {
    const auto excess = [&](double value) {
      return probability_below(value, samples, total) - k_quantile_levels[k];
    };
    std::uintmax_t evaluations = 60;
    const auto [low, high] = boost::math::tools::toms748_solve(
        excess, samples.points.front() - k_tails * std, samples.points.back() + k_tails * std,
        -k_quantile_levels[k], 1 - k_quantile_levels[k],
        [&](double a, double b) { return b - a < 1e-9 * std; }, evaluations);
    forecast.values[k] = 0.5 * (low + high);
  }
  forecast.probability_above_threshold = 1.0 - probability_below(threshold, samples, total);
}

}  // namespace

ScalarForecast forecast_of_samples(const Eigen::Ref<const Eigen::VectorXd>& values,
                                   const Eigen::Ref<const Eigen::VectorXd>& weights, double threshold,
                                   double error_std) {
  check(values, weights);
  if (!(error_std >= 0.0) || !std::isfinite(error_std))
    throw NumericalError("forecast: the model's error must have a standard deviation that is not negative");
  const std::span<const double> x(values.data(), values.size());
  const std::span<const double> w(weights.data(), weights.size());
  const double total = weights.sum();
  ScalarForecast result;
  result.mean = weights.dot(values) / total;
  result.std = std::sqrt((weights.array() * (values.array() - result.mean).square()).sum() / total);
  numerics::WeightedQuantiles().compute(x, w, k_quantile_levels, result.values);
  const double above = (values.array() > threshold).select(weights.array(), 0.0).sum() / total;
  result.probability_above_threshold = std::clamp(above, 0.0, 1.0);
  const double std = result.std, quartile_distance = result.values[3] - result.values[1];

  if (error_std > 0.0)
    add_error(bin(x, w, values.minCoeff(), values.maxCoeff(), error_std), total, error_std, threshold,
              result);
  // Never narrower than rounding allows, so that equal samples make a narrow bell instead of an infinite one.
  const double bandwidth = std::max(numerics::silverman_bandwidth(result.mean, std, quartile_distance,
                                                                  total * total / weights.squaredNorm()),
                                    1e-9 * std::max(std::abs(result.mean), 1e-9));
  numerics::KernelDensity density = numerics::kernel_density(x, w, std::hypot(bandwidth, error_std));
  result.points = std::move(density.points);
  result.density = std::move(density.density);
  result.maximum_a_posteriori = density.top;
  return result;
}

}  // namespace knothe::assimilation
