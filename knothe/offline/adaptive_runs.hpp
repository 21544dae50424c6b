#pragma once
/// @file Full-order runs chosen one round after the other: [offline.adaptive] grid_shift
/// (docs/explanation/adaptive-runs.md).
#include <string>
#include <vector>

#include "knothe/files/command_output.hpp"
#include "knothe/model/simulator/simulator.hpp"
#include "knothe/offline/grid_solving.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::offline {

/// Before anything is computed: what `grid_shift` asks of the project. ProjectError.
void check_grid_shift(const project::Project& project, const std::vector<model::Axis>& axes);

/// Makes runs where they are worth most until the posterior shift is as wanted, or no more are allowed, which
/// is a warning. Runs are kept in `parts_folder`; each round tells on stderr what it has reached and how long
/// the rest may take, and to `output` as JSON. The solutions are interpolated on a grid that splines follow;
/// runs that these are not made from are the off-grid ones. Call it on every rank of an MPI job. Errors: as
/// model::run_points; ProjectError where [simulate] measures nothing, NumericalError where the grid that
/// the model's splines need does not fit in memory.
[[nodiscard]] SolvedGrid solve_adaptive_grid(const project::Project& project, model::Simulator& solver,
                                             const std::string& parts_folder,
                                             const files::CommandOutput& output);

}  // namespace knothe::offline
