#include "knothe/assimilation/data/time_matching.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {

std::vector<std::size_t> match_times(std::span<const double> measured, std::span<const double> model,
                                     const std::string& path) {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < measured.size(); ++i) {
    const auto after = std::lower_bound(model.begin(), model.end(), measured[i]);
    std::size_t nearest = static_cast<std::size_t>(after - model.begin());
    if (nearest == model.size() ||
        (nearest > 0 && measured[i] - model[nearest - 1] < model[nearest] - measured[i])) {
      --nearest;
    }
    const double step = model.size() < 2             ? std::max(1.0, std::abs(model[0]))
                        : nearest + 1 < model.size() ? model[nearest + 1] - model[nearest]
                                                     : model[nearest] - model[nearest - 1];
    if (!(std::abs(measured[i] - model[nearest]) <= 1e-6 * step)) {
      throw DataError(fmt::format(
          "{}: time[{}] = {} is not a time of the model; the nearest is {} (step {}). Measure at model "
          "times, or interpolate the data to them",
          path, i, measured[i], model[nearest], nearest));
    }
    indices.push_back(nearest);
  }
  return indices;
}

}  // namespace knothe::assimilation
