#pragma once
/// @file From a project file to the full-order problem.
#include <vector>

#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::offline_commands {

/// Throws ProjectError if the project has no table [offline].
[[nodiscard]] mechanics::BeamProblem beam_problem(const project::Project& project);

/// The parameter axes of the grid, in the order of [offline.parameters].
[[nodiscard]] std::vector<reduction::Axis> parameter_axes(const project::Project& project);

}  // namespace knothe::offline_commands
