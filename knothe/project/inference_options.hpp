#pragma once
/// @file The tables of a project file that only `knothe infer` reads. Private to this room.
#include "knothe/project/project_file.hpp"
#include "knothe/project/project_values.hpp"

namespace knothe::project {

/// [model] umbridge and what belongs to it.
[[nodiscard]] UmbridgeOptions read_umbridge(Values& values);
/// [observations], with its noise checked: sizes, symmetry, definiteness.
[[nodiscard]] ObservationOptions read_observations(Values& values);

}  // namespace knothe::project
