#pragma once
/// @file Median and quantiles of plain numbers.
#include <algorithm>
#include <cstddef>
#include <vector>

namespace knothe::numerics {

/// Of an even count the upper one of the two in the middle; 0 of none.
template <class Values>
[[nodiscard]] double upper_median(Values values) {
  if (values.size() == 0) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Value at `level` (0 … 1) of the sorted numbers, linear in between. `values` must not be empty.
[[nodiscard]] inline double quantile(std::vector<double> values, double level) {
  std::sort(values.begin(), values.end());
  const double at = std::clamp(level, 0.0, 1.0) * static_cast<double>(values.size() - 1);
  const auto lower = static_cast<std::size_t>(at);
  const std::size_t upper = std::min(lower + 1, values.size() - 1);
  return values[lower] + (at - static_cast<double>(lower)) * (values[upper] - values[lower]);
}

}  // namespace knothe::numerics
