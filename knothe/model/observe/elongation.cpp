/// @file What a project file needs of `ScalarObservation`, without the model.
#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/model/observe/scalar_observations.hpp"

namespace knothe::model {

ScalarObservation ScalarObservation::elongation(const std::string& name, std::span<const double, 3> from,
                                                std::span<const double, 3> to, bool strain) {
  const double length = std::hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]);
  if (!(length > 0)) {
    throw UsageError(fmt::format("sensor \"{}\" is between a point and itself: give two points", name));
  }
  ScalarObservation sensor;
  sensor.name = name;
  sensor.units = strain ? "1" : "m";
  for (std::size_t c = 0; c < 3; ++c) {
    const double direction = (to[c] - from[c]) / length / (strain ? length : 1);
    if (direction == 0) continue;
    for (const auto& [point, sign] : {std::pair(to, 1.0), std::pair(from, -1.0)}) {
      sensor.points.insert(sensor.points.end(), point.begin(), point.end());
      sensor.components.push_back(c);
      sensor.coefficients.push_back(sign * direction);
    }
  }
  return sensor;
}

}  // namespace knothe::model
