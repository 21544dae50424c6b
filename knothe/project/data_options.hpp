#pragma once
/// @file Reading of [data.sensors]. Private to this room.
#include <string>

#include "knothe/reduction/observe/scalar_observations.hpp"

namespace knothe::project {

struct Values;

/// The sensor [data.sensors.NAME]; complains of what it lacks.
[[nodiscard]] reduction::ScalarObservation read_sensor(Values& values, const std::string& name);

}  // namespace knothe::project
