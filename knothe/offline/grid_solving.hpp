#pragma once
/// @file Full-order solutions on a project's grid of parameters, refined until it is fine enough.
#include <string>
#include <vector>

#include "knothe/files/command_output.hpp"
#include "knothe/model/grid/grid_solutions.hpp"
#include "knothe/model/simulator/grid_runs.hpp"
#include "knothe/offline/full_order/offline.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::offline {

/// What a model is made of.
struct SolvedGrid {
  model::GridSolutions solutions;
  std::vector<model::OffGridSolution> off_grid;  ///< where they were needed already
  std::size_t failed = 0;                        ///< runs that were left out
};

/// A record of a run for other programs; on stderr a warning where the solver does not trust its solution.
void report_run(const model::RunSummary& run, const files::CommandOutput& output);

/// The runs of the project's grid as it stands in the project file.
[[nodiscard]] model::RunGrid run_grid_of(const project::Project& project, const std::string& parts_folder);

/// Solves at all points of the project's grid, and of finer ones until `grid_error` of [offline.adaptive] is
/// met at runs off the grid; old runs are kept in `parts_folder`. Prints a line for each run; warnings go
/// to stderr. Errors: as model::run_grid; ProjectError for axes of two nodes that are to be refined.
[[nodiscard]] SolvedGrid solve_project_grid(const project::Project& project, model::Simulator& solver,
                                            const std::string& parts_folder,
                                            const files::CommandOutput& output);

/// The beam's solutions at all points of the grid at once, by LATIN-PGD. Prints a line for each global stage.
/// Errors: as solve_latin_grid.
[[nodiscard]] model::GridSolutions solve_latin(const project::Project& project,
                                               const std::string& parts_folder,
                                               const files::CommandOutput& output);

/// Points of the box that are in no grid, to judge interpolation as well as compression: eight; 24 with
/// `scaling`, where one costs little beside the runs of many load steps.
[[nodiscard]] std::vector<std::vector<double>> off_grid_points(const project::Project& project,
                                                               const std::vector<model::Axis>& axes);

/// Full-order solutions there, in parallel and kept like those of the grid `grid`, in whose box they are. By
/// the members of a job together where `share` says so. Errors: as model::run_points.
[[nodiscard]] std::vector<model::OffGridSolution> solve_off_grid(const project::Project& project,
                                                                 model::Simulator& solver,
                                                                 model::RunGrid grid,
                                                                 const model::JobShare& share = {});

}  // namespace knothe::offline
