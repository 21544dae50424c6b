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

/// What a model is made of.
struct SolvedGrid {
  reduction::GridSolutions solutions;
  std::vector<reduction::OffGridSolution> off_grid;  ///< where they were needed already
  std::size_t failed = 0;                            ///< runs that were left out
};

/// A record of a run for other programs; on stderr a warning where the solver does not trust its solution.
void report_run(const simulator::RunSummary& run, const files::CommandOutput& output);

/// The runs of the project's grid as it stands in the project file.
[[nodiscard]] simulator::RunGrid run_grid_of(const project::Project& project,
                                             const std::string& parts_folder);

/// Solves at all points of the project's grid, and of finer ones until `grid_error` of [offline.adaptive] is
/// met at runs off the grid; old runs are kept in `parts_folder`. Prints a line for each run; warnings go
/// to stderr. Errors: as simulator::run_grid; ProjectError for axes of two nodes that are to be refined.
[[nodiscard]] SolvedGrid solve_project_grid(const project::Project& project, simulator::Simulator& solver,
                                            const std::string& parts_folder,
                                            const files::CommandOutput& output);

/// The beam's solutions at all points of the grid at once, by LATIN-PGD. Prints a line for each global stage.
/// Errors: as solve_latin_grid.
[[nodiscard]] reduction::GridSolutions solve_latin(const project::Project& project,
                                                   const std::string& parts_folder,
                                                   const files::CommandOutput& output);

/// Eight points of the box that are in no grid, to judge interpolation as well as compression.
[[nodiscard]] std::vector<std::vector<double>> off_grid_points(const std::vector<reduction::Axis>& axes);

/// Full-order solutions there, in parallel and kept like those of the grid `grid`, in whose box they are. By
/// the members of a job together where `share` says so. Errors: as simulator::run_points.
[[nodiscard]] std::vector<reduction::OffGridSolution> solve_off_grid(simulator::Simulator& solver,
                                                                     simulator::RunGrid grid,
                                                                     const simulator::JobShare& share = {});

}  // namespace knothe::offline
