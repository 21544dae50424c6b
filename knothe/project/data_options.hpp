#pragma once
/// @file Reading of [data.sensors] and [parameters]. Private to this room.
#include <vector>

#include "knothe/project/project_file.hpp"

namespace knothe::project {

/// The sensors [data.sensors.NAME]; complains of what they lack.
[[nodiscard]] std::vector<model::ScalarObservation> read_sensors(Values& values);

/// What was recorded beside pictures, fields or the first data file: `data.file` and [data.sources.NAME],
/// into the project, whose pictures, fields and service are read; then `project.data` is the fields.
/// Complains of clocks of a file that stands alone.
void read_sources(Values& values, Project& project);

/// The table [parameters], into the project; complains of keys that a prior lacks or does not take.
void read_parameters(Values& values, Project& project);

}  // namespace knothe::project
