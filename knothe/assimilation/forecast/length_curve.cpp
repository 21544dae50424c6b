#include "knothe/assimilation/forecast/length_curve.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::assimilation {
namespace {

/// Piecewise linear from column `from` to the other one.
double look_up(const LengthCurve::Points& points, std::size_t from, double x) {
  if (points.empty()) return x;
  const std::size_t to = 1 - from;
  const auto after = std::upper_bound(points.begin(), points.end(), x,
                                      [&](double value, const auto& point) { return value < point[from]; });
  if (after == points.begin()) return x + points.front()[to] - points.front()[from];
  if (after == points.end()) return x + points.back()[to] - points.back()[from];
  const auto& low = *(after - 1);
  const double share = (x - low[from]) / ((*after)[from] - low[from]);
  return low[to] + share * ((*after)[to] - low[to]);
}

/// Mean and standard deviation of `value(l)`, l of a density that is linear between its points.
template <class Value>
std::pair<double, double> moments(const std::vector<double>& points, const std::vector<double>& density,
                                  const Value& value) {
  constexpr int k_parts = 16;  // of each interval: kinks are anywhere
  double mass = 0, first = 0, second = 0;
  const double origin = value(points.front());
  for (Index i = 0; i + 1 < std::ssize(points); ++i)
    for (int part = 0; part < k_parts; ++part) {
      const double share = (part + 0.5) / k_parts;
      const double here = value(std::lerp(points[i], points[i + 1], share)) - origin;
      const double weight = std::lerp(density[i], density[i + 1], share) * (points[i + 1] - points[i]);
      mass += weight, first += weight * here, second += weight * here * here;
    }
  const double mean = first / mass;
  return {origin + mean, std::sqrt(std::max(second / mass - mean * mean, 0.0))};
}

}  // namespace

LengthCurve::LengthCurve(Points points) : points_(std::move(points)) {
  for (Index i = 0; i < std::ssize(points_); ++i)
    for (std::size_t k = 0; k < 2; ++k)
      if (!std::isfinite(points_[i][k]) || (i > 0 && points_[i][k] <= points_[i - 1][k]))
        throw ProjectError(fmt::format(
            "crack length: length_curve[{}] = [{}, {}]: both lengths, elastic and meant, must be finite and "
            "increase from point to point",
            i, points_[i][0], points_[i][1]));
}

double LengthCurve::operator()(double elastic) const {
  return look_up(points_, 0, elastic);
}

double LengthCurve::inverse(double meant) const {
  return look_up(points_, 1, meant);
}

ScalarForecast LengthCurve::operator()(ScalarForecast forecast) const {
  if (is_identity()) return forecast;
  const std::vector<double> elastic = forecast.points;
  for (double& value : forecast.values) value = (*this)(value);
  for (double& point : forecast.points) point = (*this)(point);
  const auto [mean, std] = moments(elastic, forecast.density, std::identity());
  const auto [meant_mean, meant_std] = moments(elastic, forecast.density, *this);
  forecast.mean += meant_mean - mean;
  forecast.std *= meant_std / std;
  for (Index i = 0; i < std::ssize(elastic); ++i) {
    const Index low = i > 0 ? i - 1 : i, high = std::min(i + 1, std::ssize(elastic) - 1);
    forecast.density[i] *= (elastic[high] - elastic[low]) / (forecast.points[high] - forecast.points[low]);
  }
  const auto most = std::max_element(forecast.density.begin(), forecast.density.end());
  forecast.maximum_a_posteriori = forecast.points[most - forecast.density.begin()];
  return forecast;
}

}  // namespace knothe::assimilation
