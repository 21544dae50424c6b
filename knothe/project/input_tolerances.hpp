#pragma once
/// @file The table [tolerances]: which inputs may be wrong, and by how much.
#include <vector>

#include "knothe/assimilation/engine/input_errors.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::project {

/// Of the displacements, the model's time, both at once (a pixel size by which the imposed displacement is
/// measured too), each series, and Young's modulus of the built-in beam, as far as the test has them.
/// ProjectError where [tolerances] names something else.
[[nodiscard]] std::vector<assimilation::InputError> input_errors(const Project& project,
                                                                 const UpdateSetup& setup);

}  // namespace knothe::project
