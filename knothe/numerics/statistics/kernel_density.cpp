#include "knothe/numerics/statistics/kernel_density.hpp"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::numerics {

namespace {

void require(std::span<const double> values, std::span<const double> weights) {
  if (values.empty() || values.size() != weights.size())
    throw UsageError(fmt::format("kernel density: {} values and {} weights", values.size(), weights.size()));
  double total = 0;
  for (Index i = 0; i < std::ssize(values); ++i) {
    if (!std::isfinite(values[i]) || !std::isfinite(weights[i]) || weights[i] < 0)
      throw UsageError(
          fmt::format("kernel density: point {} is {} with weight {}; points must be finite, weights finite "
                      "and not negative",
                      i, values[i], weights[i]));
    total += weights[i];
  }
  if (!(total > 0)) throw UsageError("kernel density: no weight is positive");
}

}  // namespace

double effective_count(std::span<const double> weights) {
  double sum = 0, squares = 0;
  for (double w : weights) sum += w, squares += w * w;
  return sum * sum / squares;
}

double kernel_bandwidth(std::span<const double> values, std::span<const double> weights) {
  require(values, weights);
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  double mean = 0, variance = 0;
  for (Index i = 0; i < std::ssize(values); ++i) mean += weights[i] / total * values[i];
  for (Index i = 0; i < std::ssize(values); ++i)
    variance += weights[i] / total * std::pow(values[i] - mean, 2);
  std::array<double, 2> quartile{};
  WeightedQuantiles().compute(values, weights, std::array{0.25, 0.75}, quartile);
  const double robust = (quartile[1] - quartile[0]) / 1.34, std = std::sqrt(variance);
  const double spread = robust > 0 ? std::min(std, robust) : std;
  return std::max(0.9 * spread * std::pow(effective_count(weights), -0.2), 1e-12 * (1 + std::abs(mean)));
}

std::vector<double> kernel_density(std::span<const double> values, std::span<const double> weights,
                                   double bandwidth, std::span<const double> at) {
  require(values, weights);
  if (!(bandwidth > 0))
    throw UsageError(fmt::format("kernel density: bandwidth {} is not positive", bandwidth));
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  const double scale = 1 / (total * bandwidth * std::sqrt(2 * std::numbers::pi));
  // In increasing order, so that the kernels that reach a point are neighbours: exponentials in SIMD lanes.
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  if (!std::is_sorted(values.begin(), values.end()))
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  Eigen::ArrayXd sorted(std::ssize(values)), share(sorted.size());
  for (Index i = 0; i < sorted.size(); ++i) {
    sorted[i] = values[order[i]];
    share[i] = weights[order[i]];
  }
  const double* begin_of_all = sorted.data();
  const double* end_of_all = begin_of_all + sorted.size();
  std::vector<double> density;
  density.reserve(at.size());
  for (double x : at) {
    const double* first = std::lower_bound(begin_of_all, end_of_all, x - 9 * bandwidth);
    const double* last = std::upper_bound(first, end_of_all, x + 9 * bandwidth);
    const Index begin = first - begin_of_all, count = last - first;
    const auto u = (x - sorted.segment(begin, count)) / bandwidth;
    density.push_back(scale * (share.segment(begin, count) * (-0.5 * u.square()).exp()).sum());
  }
  return density;
}

}  // namespace knothe::numerics
