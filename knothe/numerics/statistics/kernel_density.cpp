#include "knothe/numerics/statistics/kernel_density.hpp"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::numerics {
namespace {

constexpr Index k_intervals = 160;
constexpr double k_margin = 3.5, k_reach = 9;  // bandwidths
constexpr double k_bins_per_bandwidth = 8, k_max_bins_per_interval = 8;

struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -low;
};

Range range_of(std::span<const double> values, std::span<const double> weights) {
  if (values.size() != weights.size())
    throw UsageError(fmt::format("kernel density: {} values and {} weights", values.size(), weights.size()));
  Range range;
  for (Index i = 0; i < std::ssize(values); ++i) {
    if (!std::isfinite(values[i]) || !std::isfinite(weights[i]) || weights[i] < 0)
      throw UsageError(
          fmt::format("kernel density: point {} is {} with weight {}; points must be finite, weights finite "
                      "and not negative",
                      i, values[i], weights[i]));
    if (weights[i] == 0) continue;
    range.low = std::min(range.low, values[i]);
    range.high = std::max(range.high, values[i]);
  }
  if (!(range.low <= range.high)) throw UsageError("kernel density: no weight is positive");
  return range;
}

/// The top of the parabola through the largest of three values and its neighbours, in units of their
/// distance.
double top_between(double left, double here, double right) {
  const double curvature = left - 2 * here + right;
  return curvature < 0 ? std::clamp(0.5 * (left - right) / curvature, -0.5, 0.5) : 0.0;
}

}  // namespace

double silverman_bandwidth(double mean, double std, double quartile_distance, double count) {
  const double robust = quartile_distance / 1.34, spread = robust > 0 ? std::min(std, robust) : std;
  return std::max(0.9 * spread * std::pow(count, -0.2), 1e-12 * (1 + std::abs(mean)));
}

KernelDensity kernel_density(std::span<const double> values, std::span<const double> weights,
                             double bandwidth) {
  const Range range = range_of(values, weights);
  if (!(bandwidth > 0))
    throw UsageError(fmt::format("kernel density: bandwidth {} is not positive", bandwidth));
  const double low = range.low - k_margin * bandwidth;
  const double spacing = (range.high - range.low + 2 * k_margin * bandwidth) / k_intervals;
  const Index parts =
      std::clamp(std::ceil(k_bins_per_bandwidth * spacing / bandwidth), 1.0, k_max_bins_per_interval);
  const double width = spacing / parts;  // of a bin
  const Index bins = k_intervals * parts + 1;
  const Index reach = std::min(std::ceil(k_reach * bandwidth / width), 1.0 * bins);

  Eigen::VectorXd mass = Eigen::VectorXd::Zero(bins + 2 * reach);
  double total = 0, spread = 0;
  for (Index i = 0; i < std::ssize(values); ++i) {
    const double place = std::max((values[i] - low) / width, 0.0);
    const Index left = std::min<Index>(place, bins - 2);
    const double share = std::min(place - left, 1.0);
    mass[reach + left] += (1 - share) * weights[i];
    mass[reach + left + 1] += share * weights[i];
    total += weights[i], spread += weights[i] * share * (1 - share);
  }
  const double variance = bandwidth * bandwidth;
  const double kernel_std = std::sqrt(std::max(variance - width * width * spread / total, 0.25 * variance));
  const Eigen::ArrayXd distance =
      Eigen::ArrayXd::LinSpaced(2 * reach + 1, -1.0 * reach, 1.0 * reach) * (width / kernel_std);
  const Eigen::VectorXd kernel =
      (-0.5 * distance.square()).exp() / (total * kernel_std * std::sqrt(2 * std::numbers::pi));
  const auto density_at = [&](Index bin) { return mass.segment(bin, kernel.size()).dot(kernel); };

  KernelDensity result;
  for (Index k = 0; k <= k_intervals; ++k) {
    result.points.push_back(low + spacing * k);
    result.density.push_back(density_at(k * parts));
  }
  const Index near = std::max_element(result.density.begin(), result.density.end()) - result.density.begin();
  const Index first = std::max<Index>((near - 1) * parts, 1), last = std::min((near + 1) * parts, bins - 2);
  Index best = first;
  double largest = density_at(best);
  for (Index bin = first + 1; bin <= last; ++bin)
    if (const double here = density_at(bin); here > largest) best = bin, largest = here;
  result.top = low + width * (best + top_between(density_at(best - 1), largest, density_at(best + 1)));
  return result;
}

}  // namespace knothe::numerics
