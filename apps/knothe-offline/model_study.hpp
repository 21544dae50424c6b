#pragma once
/// @file What the number of modes costs: errors of the field, and of the posterior, for both forms.
#include <optional>
#include <vector>

#include "knothe/assimilation/update/posterior_shift.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/grid/grid_solutions.hpp"

namespace knothe::offline_commands {

/// What a project's [parameters] and [simulate] say of an assimilation, for a model with these axes and dofs.
struct SyntheticProblem {
  std::vector<std::string> names;  ///< of the axes, in their order
  std::vector<assimilation::Prior> priors;
  std::vector<std::size_t> dofs;  ///< observed
  std::vector<double> points;     ///< [n_obs, 3], m
  std::vector<std::int64_t> components;
  double noise_std = 1e-6;  ///< m
  std::uint64_t seed = 1;
};
/// Nothing where the project has no [simulate] that chooses dofs (it may draw pictures), or no prior for one
/// of the axes.
[[nodiscard]] std::optional<SyntheticProblem> synthetic_problem(const project::Project& project,
                                                                const std::vector<reduction::Axis>& axes,
                                                                const reduction::Dofs& dofs);
/// The observed dofs of [simulate]; all where it chooses none.
[[nodiscard]] std::vector<std::size_t> judged_dofs(const project::Project& project,
                                                   const reduction::Dofs& dofs);

/// Before anything is computed: [offline.adaptive] posterior_shift has the [simulate] and [parameters] it
/// needs. ProjectError.
void check_adaptive(const project::Project& project, const std::vector<reduction::Axis>& axes);

/// Points of the box of `axes`, a scrambled Sobol sequence.
[[nodiscard]] std::vector<std::vector<double>> points_in_box(const std::vector<reduction::Axis>& axes,
                                                             int count, std::uint64_t seed);

/// The smallest number of modes among 3, 6, 10, 15, 20, 30, 40, 50, 65, 80, 100 that meets [offline.adaptive]
/// (canonical: to 30). Tells on stderr. NumericalError, with what was reached, if none does.
[[nodiscard]] std::size_t choose_modes(const project::Project& project,
                                       const reduction::GridSolutions& solutions, reduction::Form form);

/// One line: a model, its error on the grid, and how far it moves the posterior of synthetic data from that
/// of the uncompressed snapshots (absent where the project has no [parameters] or no [simulate]).
struct StudyLine {
  reduction::Form form;
  reduction::CompressionRow errors;
  std::optional<assimilation::ShiftSummary> shift;
};

/// (With more than three parameters: the tree form alone, without shifts.) Both forms with 3, 6, 10, 20 and
/// 30 modes (tree: 50 too), as far as the snapshots have so many. `off_grid`: full-order solutions at
/// parameters that are no grid points.
[[nodiscard]] std::vector<StudyLine> study_models(const project::Project& project,
                                                  const reduction::GridSolutions& solutions,
                                                  const std::vector<reduction::OffGridSolution>& off_grid);

/// A table on stdout, or JSON lines.
void report_study(const std::vector<StudyLine>& lines, bool json);

}  // namespace knothe::offline_commands
