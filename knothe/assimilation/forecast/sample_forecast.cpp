#include <algorithm>
#include <boost/math/tools/toms748_solve.hpp>
#include <cmath>
#include <cstdint>

#include "knothe/assimilation/forecast/scalar_forecast.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/statistics/kernel_density.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::assimilation {
namespace {

constexpr int k_density_points = 161;

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

/// Many samples as few: their weights shared out linearly over even points, an eighth of the kernel's width
/// apart. The mean stays; the variance that this adds is taken from the kernel's.
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

/// Top of a density known at even points: the top of the parabola through the largest value and its
/// neighbours.
double top_of(const std::vector<double>& points, const std::vector<double>& density) {
  const std::size_t best = std::max_element(density.begin(), density.end()) - density.begin();
  if (best == 0 || best + 1 == points.size()) return points[best];
  const double curvature = density[best - 1] - 2.0 * density[best] + density[best + 1];
  if (!(curvature < 0.0)) return points[best];
  const double shift = 0.5 * (density[best - 1] - density[best + 1]) / curvature;
  return points[best] + std::clamp(shift, -0.5, 0.5) * (points[best + 1] - points[best]);
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

  // Never narrower than rounding allows, so that equal samples make a narrow bell instead of an infinite one.
  const double kernel =
      std::max(numerics::kernel_bandwidth(x, w), 1e-9 * std::max(std::abs(result.mean), 1e-9));
  const double width = std::hypot(kernel, error_std);
  result.points =
      even_points(values.minCoeff() - 3.5 * width, values.maxCoeff() + 3.5 * width, k_density_points);
  const auto binned_for = [&](double std) { return bin(x, w, values.minCoeff(), values.maxCoeff(), std); };
  if (error_std > 0.0) add_error(binned_for(error_std), total, error_std, threshold, result);
  const Binned binned = binned_for(width);
  result.density = numerics::kernel_density(binned.points, binned.weights, binned.kernel_std, result.points);
  const auto best = std::max_element(result.density.begin(), result.density.end()) - result.density.begin();
  const double spacing = result.points[1] - result.points[0];
  const double centre = result.points[best];
  const std::vector<double> near = even_points(centre - spacing, centre + spacing, 33);
  result.maximum_a_posteriori =
      top_of(near, numerics::kernel_density(binned.points, binned.weights, binned.kernel_std, near));
  return result;
}

}  // namespace knothe::assimilation
