#include "knothe/likelihood/data/time_matching.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"

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
