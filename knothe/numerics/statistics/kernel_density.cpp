#include "knothe/numerics/statistics/kernel_density.hpp"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::numerics {

namespace {

constexpr std::size_t k_grid = 512;

void require(std::span<const double> values, std::span<const double> weights) {
  if (values.empty() || values.size() != weights.size())
    throw UsageError(fmt::format("kernel density: {} values and {} weights", values.size(), weights.size()));
  double total = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i]) || !std::isfinite(weights[i]) || weights[i] < 0)
      throw UsageError(
          fmt::format("kernel density: point {} is {} with weight {}; points must be finite, weights finite "
                      "and not negative",
                      i, values[i], weights[i]));
    total += weights[i];
  }
  if (!(total > 0)) throw UsageError("kernel density: no weight is positive");
}

double silverman(std::span<const double> values, std::span<const double> weights) {
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  double mean = 0, variance = 0;
  for (std::size_t i = 0; i < values.size(); ++i) mean += weights[i] / total * values[i];
  for (std::size_t i = 0; i < values.size(); ++i)
    variance += weights[i] / total * std::pow(values[i] - mean, 2);
  std::array<double, 2> quartile{};
  WeightedQuantiles().compute(values, weights, std::array{0.25, 0.75}, quartile);
  const double robust = (quartile[1] - quartile[0]) / 1.34, std = std::sqrt(variance);
  const double spread = robust > 0 ? std::min(std, robust) : std;
  return std::max(0.9 * spread * std::pow(effective_count(weights), -0.2), 1e-12 * (1 + std::abs(mean)));
}

/// ‖f^(s)‖² of the estimate with variance t, from the cosine coefficients a_k² of the histogram (Botev et
/// al., section 5).
double derivative_norm(const std::vector<double>& squares, int s, double t) {
  double sum = 0;
  for (std::size_t k = 1; k < squares.size(); ++k) {
    const double k2 = static_cast<double>(k * k) * std::numbers::pi * std::numbers::pi;
    sum += std::pow(k2, s) * squares[k] * std::exp(-k2 * t);
  }
  return 0.5 * sum;
}

/// t − ξ γ^[7](t): its root is the squared bandwidth in units of the grid's length (Botev et al., Eq. 28 f.).
double fixed_point(double t, double n, const std::vector<double>& squares) {
  double norm = derivative_norm(squares, 7, t);
  for (int s = 6; s >= 2; --s) {
    double odd = 1;
    for (int k = 1; k < 2 * s; k += 2) odd *= k;
    const double constant = (1 + std::pow(0.5, s + 0.5)) / 3 * odd / std::sqrt(std::numbers::pi / 2);
    norm = derivative_norm(squares, s, std::pow(2 * constant / (n * norm), 2 / (3.0 + 2 * s)));
  }
  return t - std::pow(2 * n * std::sqrt(std::numbers::pi) * norm, -0.4);
}

double improved_sheather_jones(std::span<const double> values, std::span<const double> weights,
                               double fallback) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const double range = *high - *low;
  if (!(range > 0)) return fallback;
  const double left = *low - 0.25 * range, length = 1.5 * range;
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  std::vector<double> histogram(k_grid, 0.0), squares(k_grid, 0.0);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto bin = static_cast<std::size_t>((values[i] - left) / length * k_grid);
    histogram[std::min(bin, k_grid - 1)] += weights[i] / total;
  }
  for (std::size_t k = 0; k < k_grid; ++k) {  // cosine transform; 512² is nothing here
    double a = 0;
    for (std::size_t j = 0; j < k_grid; ++j)
      if (histogram[j] != 0)
        a += histogram[j] *
             std::cos(std::numbers::pi * static_cast<double>(k) * (static_cast<double>(j) + 0.5) / k_grid);
    squares[k] = 4 * a * a;
  }
  const double n = effective_count(weights);
  // The smallest root: the function is negative at 0+, march out geometrically, then bisect.
  double a = 1e-8, b = a;
  while (b < 0.1 && !(fixed_point(b, n, squares) > 0)) a = b, b *= 1.5;
  if (b >= 0.1 || a == b) return fallback;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (a + b);
    (fixed_point(middle, n, squares) > 0 ? b : a) = middle;
  }
  return std::sqrt(0.5 * (a + b)) * length;
}

}  // namespace

double effective_count(std::span<const double> weights) {
  double sum = 0, squares = 0;
  for (double w : weights) sum += w, squares += w * w;
  return sum * sum / squares;
}

double kernel_bandwidth(std::span<const double> values, std::span<const double> weights, Bandwidth rule) {
  require(values, weights);
  const double simple = silverman(values, weights);
  return rule == Bandwidth::silverman ? simple : improved_sheather_jones(values, weights, simple);
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
  Eigen::ArrayXd sorted(static_cast<Eigen::Index>(values.size())), share(sorted.size());
  for (Eigen::Index i = 0; i < sorted.size(); ++i) {
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
    const Eigen::Index begin = first - begin_of_all, count = last - first;
    const auto u = (x - sorted.segment(begin, count)) / bandwidth;
    density.push_back(scale * (share.segment(begin, count) * (-0.5 * u.square()).exp()).sum());
  }
  return density;
}

}  // namespace knothe::numerics
