#pragma once
/// @file Median, quantiles and two classes of plain numbers.
#include <algorithm>
#include <cstddef>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// Of an even count the upper one of the two in the middle; 0 of none.
template <class Values>
[[nodiscard]] double upper_median(Values values) {
  if (values.size() == 0) return 0;
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Value at `level` (0 … 1) of the sorted numbers, linear in between. `values` must not be empty.
[[nodiscard]] inline double quantile(std::vector<double> values, double level) {
  std::sort(values.begin(), values.end());
  const double at = std::clamp(level, 0.0, 1.0) * (values.size() - 1);
  const std::size_t lower = at;
  const std::size_t upper = std::min(lower + 1, values.size() - 1);
  return values[lower] + (at - lower) * (values[upper] - values[lower]);
}

/// Two classes of numbers, split where the variance between them is largest (Otsu 1979).
struct TwoClasses {
  double threshold = 0, explained = 0;  ///< in the middle of the gap; share of the variance between classes
  double apart = 0, share_below = 0;    ///< distance of the means; share of the numbers in the lower class
};
/// Of numbers that are all the same the threshold is that number.
[[nodiscard]] inline TwoClasses two_classes(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  double total = 0, squares = 0, below = 0, best = 0;
  for (const double v : values) total += v, squares += v * v;
  const double n = values.size();
  TwoClasses classes;
  if (!values.empty()) classes.threshold = values.back();
  for (Index i = 1; i < std::ssize(values); ++i) {
    below += values[i - 1];
    const double k = i;
    const double apart = (total - below) / (n - k) - below / k,
                 between = k * (n - k) / (n * n) * apart * apart;
    if (between > best) best = between, classes = {0.5 * (values[i - 1] + values[i]), 0, apart, k / n};
  }
  const double variance = squares / n - (total / n) * (total / n);
  if (variance > 0) classes.explained = best / variance;
  return classes;
}

}  // namespace knothe::numerics
