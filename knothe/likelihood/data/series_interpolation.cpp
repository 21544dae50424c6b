#include "knothe/likelihood/data/series_interpolation.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/likelihood/data/time_matching.hpp"

namespace knothe::likelihood {
namespace {

/// Slope by least squares of the values `from` … `to` (indices, both included) that are not missing.
double slope(const std::vector<double>& values, std::span<const double> times, Index from, Index to) {
  double count = 0, time = 0, value = 0, square = 0, product = 0;
  for (Index i = from; i <= to; ++i) {
    if (std::isnan(values[i])) continue;
    const double t = times[i] - times[from];
    ++count, time += t, value += values[i], square += t * t, product += t * values[i];
  }
  return (count * product - time * value) / (count * square - time * time);  // NaN of a single value
}

}  // namespace

MeasuredSeries interpolate_series(const MeasuredSeries& series, std::span<const double> from,
                                  std::span<const double> to, double window) {
  assert(series.values.size() == from.size());
  constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();
  MeasuredSeries result{{}, series.std, {}, series.units, {}, {}};
  const double slack = from.empty() ? 0 : 1e-9 * (from.back() - from.front());
  for (double time : to) {
    if (from.size() < 2 || !(time >= from.front() - slack && time <= from.back() + slack)) {
      result.values.push_back(k_nan);
      result.rate.push_back(k_nan);
      if (!series.shared_std.empty())
        result.shared_std.push_back(time < from.front() ? series.shared_std.front()
                                                        : series.shared_std.back());
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
    const auto first = std::lower_bound(from.begin(), from.end(), time - window) - from.begin();
    const auto last = std::upper_bound(from.begin(), from.end(), time + window) - from.begin() - 1;
    result.rate.push_back(slope(series.values, from, std::min(first, k - 1), std::max(last, k)));
    if (!series.shared_std.empty()) result.shared_std.push_back(between(series.shared_std));
  }
  return result;
}

Measurements at_times(Measurements measured, std::span<const double> to) {
  constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();
  if (lasting_count(measured.noise) > 0)
    throw DataError(
        "noise/shared_errors is known at the times of the file alone: `knothe assimilate` takes it, data "
        "that "
        "come one by one have none");
  for (auto& [name, series] : measured.series) series = interpolate_series(series, measured.time, to);
  Eigen::MatrixXd values = Eigen::MatrixXd::Constant(measured.values.rows(), std::ssize(to), k_nan);
  for (std::size_t t = 0; t < measured.time.size(); ++t)
    if (const auto there = matching_time(measured.time[t], to)) values.col(*there) = measured.values.col(t);
  measured.values = std::move(values);
  measured.time.assign(to.begin(), to.end());
  return measured;
}

}  // namespace knothe::likelihood
