#pragma once
/// @file The beam of the paper with all that it leaves open decided, and the reduced models of it.
#include <functional>
#include <string>
#include <vector>

#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/reduction/model/separated_model.hpp"

namespace knothe::reproduction {

/// A choice of everything that the paper does not say.
struct BeamCase {
  std::string name;  ///< of its model's file
  std::string what;  ///< the choice in words
  mechanics::BeamProblem problem;
  int nodes = 9;  ///< of the parameter grid, per axis
  /// Of a spring between the imposed displacement and the beam, N/m; 0: none (`behind_spring`).
  double machine_stiffness = 0;
  std::string runs_of = {};  ///< name of the case that has the same full-order runs; empty: no other
};

/// Elements of 5 mm, notch of 5 mm, supports that are lines: docs/explanation/mechanics.md.
[[nodiscard]] BeamCase reference_case();
/// A guess that comes near the paper's numbers: elements (and so crack band and notch) of 20 mm, and 0.18 of
/// the 0.4 mm reaching the beam, the rest taken up by supports and plates.
[[nodiscard]] BeamCase soft_coarse_case();
/// Other choices, one thing changed in each; the first is the quickest.
[[nodiscard]] std::vector<BeamCase> other_cases();

/// The case with a spring in series, of the stiffness with which the load at the reference parameters peaks
/// at the time `peak` (a fraction of the last imposed displacement). Errors: NumericalError where it peaks
/// later than that without a spring. Runs the full-order model once.
[[nodiscard]] BeamCase with_series_spring(BeamCase chosen, double peak);

/// Runs of a beam as they are where a spring of that stiffness [N/m] gives way between the imposed
/// displacement and the beam: u_beam = u_imposed − F / stiffness. Where the load falls faster than the spring
/// unloads, the beam jumps along its path to the next state that the imposed displacement reaches. Linear
/// between two steps. Needs the outputs imposed_displacement and reaction_force, and a first step that is
/// elastic.
[[nodiscard]] reduction::Snapshots behind_spring(reduction::Snapshots runs, double stiffness);

/// The paper's separated models of one case. Its first mode is the elastic solution, which is taken out
/// exactly here (`/lift`): its m modes are the lift and m − 1 others.
struct BeamModels {
  BeamCase chosen;
  reduction::SeparatedModel paper;  ///< m = 6: lift and the five best canonical modes, with crack solutions
  reduction::SeparatedModel three;  ///< m = 3: lift and two modes found one after the other
  reduction::SeparatedModel three_best;  ///< m = 3: lift and the two best canonical modes
  bool kept = false;                     ///< read from the folder, not built now
};

/// Reads the models from `folder`, where they are there and of the same case, else builds and writes them:
/// full-order runs on the grid in `processes` processes, finished ones kept in `folder` until the model is
/// there. Errors: as run_snapshots.
[[nodiscard]] BeamModels prepare(const BeamCase& chosen, const std::string& folder, int processes);

/// A tree model of 50 modes of the case: the most accurate there is. Kept in the same way.
[[nodiscard]] reduction::SeparatedModel prepare_accurate(const BeamCase& chosen, const std::string& folder,
                                                         int processes);

/// Full-order runs of the case on its grid; finished ones are kept in `folder` until `remove_runs`.
[[nodiscard]] reduction::Snapshots runs_of(const BeamCase& chosen, const std::string& folder, int processes);

/// The model of that file, built by `contents` and written unless it is there and of the same case and
/// `form`.
[[nodiscard]] reduction::SeparatedModel kept_or_built(
    const BeamCase& chosen, const std::string& folder, const std::string& name, const std::string& form,
    const std::function<reduction::ModelContents()>& contents);

/// Its 80 elastic solutions with a crack (Eq. 32) at these dofs.
[[nodiscard]] reduction::CrackSolutions crack_solutions(const BeamCase& chosen, const reduction::Dofs& dofs);

/// The parameter axes of the case.
[[nodiscard]] std::vector<reduction::Axis> axes_of(const BeamCase& chosen);

/// `modes` canonical modes beside the lift, each the best for what the ones before it leave: how a separated
/// model that is built mode by mode begins. The snapshots are used up. Errors of the model are those on the
/// grid.
[[nodiscard]] reduction::ModelContents mode_by_mode(reduction::Snapshots snapshots, std::size_t modes,
                                                    std::uint64_t seed);

/// `modes` canonical modes beside the lift, fitted to the first `steps` steps; over the others only their
/// time functions are, by least squares. Errors of the model are those of the first steps.
[[nodiscard]] reduction::ModelContents fitted_to_beginning(const reduction::Snapshots& snapshots,
                                                           std::size_t steps, std::size_t modes,
                                                           std::uint64_t seed);

/// The same function with the lift as first mode, normalised like the others: Eq. 30 to the letter. For a
/// lift that grows with time without changing its shape.
[[nodiscard]] reduction::SeparatedModel with_lift_as_mode(const reduction::SeparatedModel& canonical);

}  // namespace knothe::reproduction
