#pragma once
/// @file Full-order solutions on a project's grid of parameters, refined until it is fine enough.
#include <string>
#include <vector>

#include "knothe/files/command_output.hpp"
#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/grid/grid_solutions.hpp"
#include "knothe/simulator/simulator.hpp"

namespace knothe::offline {

/// Solves at all points of the project's grid, by [offline] method, and of finer ones until `grid_error` of
/// [offline.adaptive] is met at the points `off_grid`; old runs are kept in `parts_folder`. Prints a line for
/// each run or global stage; warnings go to stderr. Errors: as run_snapshots and solve_latin_grid;
/// ProjectError for axes of two nodes that are to be refined.
[[nodiscard]] reduction::GridSolutions solve_project_grid(
    const project::Project& project, const mechanics::BeamProblem& problem, const std::string& parts_folder,
    const std::vector<reduction::OffGridSolution>& off_grid, const files::CommandOutput& output);

/// Full-order solutions at eight points that are in no grid, to judge interpolation as well as compression.
[[nodiscard]] std::vector<reduction::OffGridSolution> solve_off_grid(
    simulator::Simulator& simulator, const std::vector<reduction::Axis>& axes);

}  // namespace knothe::offline
