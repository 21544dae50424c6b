#pragma once
/// @file Full-order solutions on a project's grid of parameters, refined until it is fine enough.
#include <string>
#include <vector>

#include "knothe/files/command_output.hpp"
#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/grid/grid_solutions.hpp"
#include "knothe/simulator/grid_runs.hpp"

namespace knothe::offline {

/// A record of a run for other programs; on stderr a warning where the solver does not trust its solution.
void report_run(const simulator::RunSummary& run, const files::CommandOutput& output);

/// Solves at all points of the project's grid, and of finer ones until `grid_error` of [offline.adaptive] is
/// met at the points `off_grid`; old runs are kept in `parts_folder`. Prints a line for each run; warnings go
/// to stderr. Errors: as simulator::run_grid; ProjectError for axes of two nodes that are to be refined.
[[nodiscard]] reduction::GridSolutions solve_project_grid(
    const project::Project& project, simulator::Simulator& solver, const std::string& parts_folder,
    const std::vector<reduction::OffGridSolution>& off_grid, const files::CommandOutput& output);

/// The beam's solutions at all points of the grid at once, by LATIN-PGD. Prints a line for each global stage.
/// Errors: as solve_latin_grid.
[[nodiscard]] reduction::GridSolutions solve_latin(const project::Project& project,
                                                   const std::string& parts_folder,
                                                   const files::CommandOutput& output);

/// Full-order solutions at eight points that are in no grid, to judge interpolation as well as compression.
[[nodiscard]] std::vector<reduction::OffGridSolution> solve_off_grid(
    simulator::Simulator& simulator, const std::vector<reduction::Axis>& axes);

}  // namespace knothe::offline
