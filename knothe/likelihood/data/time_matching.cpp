#include "knothe/likelihood/data/time_matching.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::likelihood {

namespace {

std::size_t nearest_time(double time, std::span<const double> model) {
  const auto after = std::lower_bound(model.begin(), model.end(), time);
  const std::size_t nearest = after - model.begin();
  const bool before_is_nearer =
      nearest == model.size() || (nearest > 0 && time - model[nearest - 1] < model[nearest] - time);
  return before_is_nearer ? nearest - 1 : nearest;
}

}  // namespace

std::vector<double> distinct_times(std::vector<double> times) {
  std::sort(times.begin(), times.end());
  struct Time {
    double value;
    Index count;
  };
  std::vector<Time> distinct;
  for (const double time : times) {
    if (distinct.empty() || distinct.back().value != time) distinct.push_back({time, 0});
    ++distinct.back().count;
  }
  std::vector<double> merged;
  if (distinct.empty()) return merged;
  const double range = distinct.back().value - distinct.front().value;
  Index groups = 1;
  for (std::size_t i = 1; i < distinct.size(); ++i)
    if (distinct[i].value - distinct[i - 1].value > 1e-6 * range / std::ssize(distinct)) ++groups;
  const double close = groups > 1 ? 1e-6 * range / (groups - 1) : 0;
  // A gap that is small but no rounding, as between logarithmic times, stays.
  const auto agree = [&](double before, double after) {
    const double gap = after - before, size = std::max(std::abs(before), std::abs(after));
    return gap <= close && (gap <= 1e-6 * size || size <= 1e-12 * range);
  };
  for (std::size_t first = 0, end; first < distinct.size(); first = end) {
    end = first + 1;
    while (end < distinct.size() && agree(distinct[end - 1].value, distinct[end].value)) ++end;
    merged.push_back(
        std::max_element(distinct.begin() + first, distinct.begin() + end, [](const Time& a, const Time& b) {
          return a.count < b.count;
        })->value);
  }
  return merged;
}

std::optional<std::size_t> matching_time(double time, std::span<const double> model) {
  const std::size_t nearest = nearest_time(time, model);
  const double step = model.size() < 2             ? std::max(1.0, std::abs(model[0]))
                      : nearest + 1 < model.size() ? model[nearest + 1] - model[nearest]
                                                   : model[nearest] - model[nearest - 1];
  if (!(std::abs(time - model[nearest]) <= 1e-6 * step)) return std::nullopt;
  return nearest;
}

std::vector<std::size_t> match_times(std::span<const double> measured, std::span<const double> model,
                                     const std::string& path) {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < measured.size(); ++i) {
    const auto index = matching_time(measured[i], model);
    if (!index) {
      const std::size_t nearest = nearest_time(measured[i], model);
      throw DataError(fmt::format(
          "{}: time[{}] = {} is not a time of the model; the nearest is {} (step {}). Measure at model "
          "times, or interpolate the data to them",
          path, i, measured[i], model[nearest], nearest));
    }
    indices.push_back(*index);
  }
  return indices;
}

}  // namespace knothe::likelihood
