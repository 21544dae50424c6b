#pragma once
/// @file Full-order runs chosen one round after the other: [offline.adaptive] grid_shift
/// (docs/explanation/adaptive-runs.md).
#include <string>
#include <vector>

#include "knothe/files/command_output.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/grid/grid_solutions.hpp"
#include "knothe/simulator/simulator.hpp"

namespace knothe::offline {

/// Before anything is computed: what `grid_shift` asks of the project. ProjectError.
void check_grid_shift(const project::Project& project, const std::vector<reduction::Axis>& axes);

struct AdaptiveSolutions {
  reduction::GridSolutions solutions;                ///< interpolated on a grid that splines follow
  std::vector<reduction::OffGridSolution> held_out;  ///< runs that these are not made from
};
/// Makes runs where they are worth most until the posterior shift is as wanted, or no more are allowed, which
/// is a warning. Runs are kept in `parts_folder`; each round tells on stderr what it has reached and how long
/// the rest may take, and to `output` as JSON. Call it on every rank of an MPI job. Errors: as
/// simulator::run_points; ProjectError where [simulate] measures nothing, NumericalError where the grid that
/// the model's splines need does not fit in memory.
[[nodiscard]] AdaptiveSolutions solve_adaptive_grid(const project::Project& project,
                                                    simulator::Simulator& solver,
                                                    const std::string& parts_folder,
                                                    const files::CommandOutput& output);

}  // namespace knothe::offline
