// The adaptive integration behind forecast_of_density: a density that may be far narrower than the first
// mesh.
#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/assimilation/forecast/scalar_forecast.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::assimilation {
namespace {

constexpr double k_depth = 45.0;  // intervals whose log-density stays this far below the peak do not matter
constexpr double k_slope =
    0.12;  // change of the log-density over half an interval where the density is largest,
constexpr double k_curvature =
    0.03;  // and its second difference; both times e for every k_relief that the density
constexpr double k_relief = 10.0;  // is below its peak: Simpson's rule is then good to some 1e-6 of the whole
constexpr int k_max_levels = 40;   // halving 40 times: below rounding of any length
constexpr std::size_t k_max_intervals = 20000;

/// An interval with the log-density at its ends and middle.
struct Interval {
  double left, right;
  double log_left, log_middle, log_right;

  [[nodiscard]] double middle() const { return 0.5 * (left + right); }
  [[nodiscard]] double largest() const { return std::max({log_left, log_middle, log_right}); }
};

/// Upper estimate of the log-density on the interval: top of the parabola through the three values if it lies
/// in or next to the interval. A narrow peak between the points shows up here before it does in the values.
double top(const Interval& i) {
  const double largest = i.largest();
  const double curvature = i.log_left - 2.0 * i.log_middle + i.log_right;
  if (!std::isfinite(curvature) || curvature >= 0.0) return largest;
  const double slope = 0.5 * (i.log_right - i.log_left);
  const double where = std::clamp(-slope / curvature, -1.5, 1.5);
  return std::max(largest, i.log_middle + slope * where + 0.5 * curvature * where * where);
}

/// Whether the density varies too much over the interval for Simpson's rule.
bool varies(const Interval& i, double peak) {
  if (i.log_left == i.log_middle && i.log_middle == i.log_right) return false;  // also -infinity throughout
  const double relief = std::exp(std::max(peak - top(i), 0.0) / k_relief);
  const double left = i.log_middle - i.log_left, right = i.log_right - i.log_middle;
  // Written so that a difference to -infinity varies.
  return !(std::max(std::abs(left), std::abs(right)) <= k_slope * relief &&
           std::abs(right - left) <= k_curvature * relief);
}

void require_usable(std::span<const double> values) {
  for (double v : values)
    if (std::isnan(v) || v == std::numeric_limits<double>::infinity())
      throw NumericalError("forecast: the log-density is not a number or infinite at a point");
}

/// Halves the intervals that matter, level by level, until the log-density varies little over each.
std::vector<Interval> refine(std::vector<Interval> intervals, const LogDensityFunction& log_density) {
  std::vector<Interval> next;
  std::vector<double> points, values;
  std::vector<bool> split;
  for (int level = 0; level < k_max_levels; ++level) {
    double peak = -std::numeric_limits<double>::infinity();
    for (const auto& i : intervals) peak = std::max(peak, i.largest());
    points.clear();
    split.assign(intervals.size(), false);
    for (Index j = 0; j < std::ssize(intervals); ++j) {
      const Interval& i = intervals[j];
      const double quarter = 0.25 * (i.right - i.left);
      const bool divisible = i.left + quarter > i.left && i.right - quarter < i.right;
      if (!divisible || top(i) < peak - k_depth || !varies(i, peak)) continue;
      split[j] = true;
      points.push_back(i.left + quarter);
      points.push_back(i.right - quarter);
    }
    if (points.empty() || intervals.size() + points.size() / 2 > k_max_intervals) break;
    values.resize(points.size());
    log_density(points, values);
    require_usable(values);
    next.clear();
    std::size_t used = 0;
    for (Index j = 0; j < std::ssize(intervals); ++j) {
      const Interval& i = intervals[j];
      if (!split[j]) {
        next.push_back(i);
        continue;
      }
      next.push_back({i.left, i.middle(), i.log_left, values[used], i.log_middle});
      next.push_back({i.middle(), i.right, i.log_middle, values[used + 1], i.log_right});
      used += 2;
    }
    intervals.swap(next);
  }
  return intervals;
}

/// Density on an interval relative to the peak, as the parabola through its three values.
struct Parabola {
  double left, width, a, b, c;  // a + b s + c s², s in [0, 1]

  Parabola(const Interval& i, double peak) : left(i.left), width(i.right - i.left) {
    const double f0 = std::exp(i.log_left - peak), f1 = std::exp(i.log_middle - peak),
                 f2 = std::exp(i.log_right - peak);
    a = f0;
    b = -3.0 * f0 + 4.0 * f1 - f2;
    c = 2.0 * f0 - 4.0 * f1 + 2.0 * f2;
  }
  /// Integral from the left end to s.
  [[nodiscard]] double mass(double s) const { return width * s * (a + s * (0.5 * b + s * c / 3.0)); }
  /// s at which the mass from the left end is `wanted`.
  [[nodiscard]] double inverse(double wanted) const {
    double low = 0.0, high = 1.0;
    for (int k = 0; k < 60; ++k) {
      const double s = 0.5 * (low + high);
      (mass(s) < wanted ? low : high) = s;
    }
    return 0.5 * (low + high);
  }
};

/// Most probable value: golden-section search beside the largest of the points, on the exact log-density.
double most_probable(const std::vector<Interval>& intervals, const LogDensityFunction& log_density) {
  double best = -std::numeric_limits<double>::infinity(), where = 0.0, low = 0.0, high = 0.0;
  for (Index j = 0; j < std::ssize(intervals); ++j) {
    const Interval& i = intervals[j];
    const auto consider = [&](double x, double value, double a, double b) {
      if (value > best) best = value, where = x, low = a, high = b;
    };
    consider(i.left, i.log_left, j > 0 ? intervals[j - 1].middle() : i.left, i.middle());
    consider(i.middle(), i.log_middle, i.left, i.right);
    consider(i.right, i.log_right, i.middle(),
             j + 1 < std::ssize(intervals) ? intervals[j + 1].middle() : i.right);
  }
  constexpr double golden = 0.6180339887498949;
  const auto value_at = [&](double x) {
    double value = 0.0;
    log_density({&x, 1}, {&value, 1});
    return value;
  };
  double x1 = high - golden * (high - low), x2 = low + golden * (high - low);
  double f1 = value_at(x1), f2 = value_at(x2);
  for (int k = 0; k < 40 && high - low > 1e-9 * (std::abs(where) + (high - low)); ++k) {
    if (f1 > f2) {
      high = x2, x2 = x1, f2 = f1, x1 = high - golden * (high - low), f1 = value_at(x1);
    } else {
      low = x1, x1 = x2, f1 = f2, x2 = low + golden * (high - low), f2 = value_at(x2);
    }
  }
  const double x = f1 > f2 ? x1 : x2;
  return std::max(f1, f2) > best ? x : where;
}

/// Writes the density down: at the ends of the first intervals, at most 80 of them, and at ends of the
/// final ones so that neighbours differ little where the density is large.
void write_density(const std::vector<Interval>& intervals, const std::vector<double>& below, double peak,
                   std::span<const double> base, ScalarForecast& result) {
  const double total = below.back();
  const std::size_t stride = 2 * std::max<std::size_t>(1, base.size() / 2 / 80);
  std::size_t next_coarse = 0;
  double last_log = 0.0, last_mass = -1.0;
  const auto visit = [&](double x, double log_value, double mass, bool last) {
    const bool coarse = next_coarse < base.size() && x >= base[next_coarse];
    const double depth = std::max(peak - log_value, 0.0);
    const bool changed = std::abs(log_value - last_log) > 0.15 * (1.0 + depth) && depth < 25.0;
    if (!coarse && !last && !changed && mass - last_mass < 0.02) return;
    while (next_coarse < base.size() && base[next_coarse] <= x) next_coarse += stride;
    last_log = std::max(log_value, peak - 25.0);
    last_mass = mass;
    result.points.push_back(x);
    result.density.push_back(std::exp(log_value - peak) / total);
  };
  for (Index j = 0; j < std::ssize(intervals); ++j)
    visit(intervals[j].left, intervals[j].log_left, below[j] / total, false);
  visit(intervals.back().right, intervals.back().log_right, 1.0, true);
}

std::vector<Interval> first_intervals(std::span<const double> base, std::span<const double> values) {
  require_usable(values);
  std::vector<Interval> intervals;
  bool anything = false;
  for (std::size_t j = 0; j + 2 < base.size(); j += 2) {
    intervals.push_back({base[j], base[j + 2], values[j], values[j + 1], values[j + 2]});
    anything = anything || std::isfinite(intervals.back().largest());
  }
  if (!anything)
    throw NumericalError("forecast: the density is zero everywhere on the range of the quantity");
  return intervals;
}

}  // namespace

ScalarForecast forecast_of_density(std::span<const double> base, std::span<const double> base_values,
                                   const LogDensityFunction& log_density, double threshold) {
  if (base.size() < 3 || base.size() % 2 == 0 || base.size() != base_values.size())
    throw NumericalError("forecast: a density needs an odd number of at least 3 points and as many values");
  const std::vector<Interval> intervals = refine(first_intervals(base, base_values), log_density);
  double peak = -std::numeric_limits<double>::infinity();
  for (const auto& i : intervals) peak = std::max(peak, i.largest());

  std::vector<Parabola> pieces;
  pieces.reserve(intervals.size());
  std::vector<double> below(intervals.size() + 1, 0.0), above(intervals.size() + 1, 0.0);
  for (Index j = 0; j < std::ssize(intervals); ++j) {
    pieces.emplace_back(intervals[j], peak);
    below[j + 1] = below[j] + pieces[j].mass(1.0);
  }
  for (std::size_t j = intervals.size(); j-- > 0;) above[j] = above[j + 1] + pieces[j].mass(1.0);
  const double total = below.back();

  ScalarForecast result;
  result.maximum_a_posteriori = most_probable(intervals, log_density);
  // Moments about the most probable value, so that a narrow density keeps its digits.
  const double centre = result.maximum_a_posteriori;
  double first = 0.0, second = 0.0;
  for (Index j = 0; j < std::ssize(intervals); ++j) {
    const Interval& i = intervals[j];
    const double step = (i.right - i.left) / 6.0;
    const double weights[3] = {step * std::exp(i.log_left - peak), 4.0 * step * std::exp(i.log_middle - peak),
                               step * std::exp(i.log_right - peak)};
    const double at[3] = {i.left - centre, i.middle() - centre, i.right - centre};
    for (int k = 0; k < 3; ++k) {
      first += weights[k] * at[k];
      second += weights[k] * at[k] * at[k];
    }
  }
  first /= total;
  result.mean = centre + first;
  result.std = std::sqrt(std::max(0.0, second / total - first * first));

  const auto quantile = [&](double level) {
    const double wanted = level * total;
    const auto after = std::upper_bound(below.begin() + 1, below.end() - 1, wanted);
    const std::size_t j = after - below.begin() - 1;
    return pieces[j].left + pieces[j].width * pieces[j].inverse(wanted - below[j]);
  };
  for (Index k = 0; k < std::ssize(k_quantile_levels); ++k) result.values[k] = quantile(k_quantile_levels[k]);

  if (threshold < base.front()) {
    result.probability_above_threshold = 1.0;
  } else if (threshold < base.back()) {
    std::size_t j = 0;
    while (j + 1 < intervals.size() && intervals[j].right <= threshold) ++j;
    const double s = (threshold - pieces[j].left) / pieces[j].width;
    const double part = std::max(0.0, pieces[j].mass(1.0) - pieces[j].mass(s));
    result.probability_above_threshold = std::min(1.0, (above[j + 1] + part) / total);
  }

  write_density(intervals, below, peak, base, result);
  return result;
}

}  // namespace knothe::assimilation
