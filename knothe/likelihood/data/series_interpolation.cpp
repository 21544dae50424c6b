#include "knothe/likelihood/data/series_interpolation.hpp"

#include <algorithm>
#include <cassert>
#include <limits>

namespace knothe::likelihood {

MeasuredSeries interpolate_series(const MeasuredSeries& series, std::span<const double> from,
                                  std::span<const double> to) {
  assert(series.values.size() == from.size());
  constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();
  MeasuredSeries result{{}, series.std, {}, series.units, {}};
  const double slack = from.empty() ? 0 : 1e-9 * (from.back() - from.front());
  for (double time : to) {
    if (from.size() < 2 || !(time >= from.front() - slack && time <= from.back() + slack)) {
      result.values.push_back(k_nan);
      result.rate.push_back(k_nan);
      if (!series.shared_std.empty()) result.shared_std.push_back(0);
      continue;
    }
    const auto k = std::lower_bound(from.begin() + 1, from.end() - 1, time - slack) - from.begin();
    const double step = from[k] - from[k - 1];
    double weight = std::clamp((time - from[k - 1]) / step, 0.0, 1.0);
    if (from[k] - time <= slack) weight = 1;  // at a value: its neighbour may be missing
    const auto between = [&](const std::vector<double>& values) {
      if (weight == 1) return values[k];
      return weight == 0 ? values[k - 1] : (1 - weight) * values[k - 1] + weight * values[k];
    };
    result.values.push_back(between(series.values));
    result.rate.push_back((series.values[k] - series.values[k - 1]) / step);
    if (!series.shared_std.empty()) result.shared_std.push_back(between(series.shared_std));
  }
  return result;
}

}  // namespace knothe::likelihood
