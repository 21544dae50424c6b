#pragma once
/// @file What the number of modes costs: errors of the field, and of the posterior, for both forms.
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "knothe/assimilation/update/posterior_shift.hpp"
#include "knothe/files/command_output.hpp"
#include "knothe/model/grid/grid_solutions.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::offline {

/// Before anything is computed: [offline.adaptive] posterior_shift has the [simulate] and [parameters] it
/// needs. ProjectError.
void check_adaptive(const project::Project& project, const std::vector<model::Axis>& axes);

/// The smallest number of modes among 3, 6, 10, 15, 20, 30, 40, 50, 65, 80, 100 that meets [offline.adaptive]
/// (canonical: to 30). Tells on stderr. NumericalError, with what was reached, if none does.
[[nodiscard]] std::size_t choose_modes(const project::Project& project, const model::GridSolutions& solutions,
                                       model::Form form);

/// Prints a line for each model: its errors on the grid and at `off_grid` (full-order solutions at parameters
/// that are no grid points), and how far it moves the posterior of synthetic data from that of the
/// uncompressed snapshots (absent where the project has no [parameters] or no [simulate]). Both forms with 3,
/// 6, 10, 20 and 30 modes (tree: 50 too), as far as the snapshots have so many; with more than three
/// parameters or 600 grid points the tree form alone, without shifts.
void study_models(const project::Project& project, const model::GridSolutions& solutions,
                  const std::vector<model::OffGridSolution>& off_grid, const files::CommandOutput& output);

/// `relative_error`, `relative_error_without_lift` and `max_error_m`.
[[nodiscard]] nlohmann::ordered_json error_record(const model::ModelError& error);

}  // namespace knothe::offline
