#pragma once
/// @file The beam of the paper with all that it leaves open decided, and the reduced models of it.
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
};

/// Elements of 5 mm, notch of 5 mm, supports that are lines: docs/explanation/mechanics.md.
[[nodiscard]] BeamCase reference_case();
/// A guess that comes near the paper's numbers: elements (and so crack band and notch) of 20 mm, and 0.18 of
/// the 0.4 mm reaching the beam, the rest taken up by supports and plates.
[[nodiscard]] BeamCase soft_coarse_case();
/// Other choices, one thing changed in each; the first is the quickest.
[[nodiscard]] std::vector<BeamCase> other_cases();

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

/// The parameter axes of the case.
[[nodiscard]] std::vector<reduction::Axis> axes_of(const BeamCase& chosen);

/// `modes` canonical modes beside the lift, each the best for what the ones before it leave: how a separated
/// model that is built mode by mode begins. The snapshots are used up. Errors of the model are those on the
/// grid.
[[nodiscard]] reduction::ModelContents mode_by_mode(reduction::Snapshots snapshots, std::size_t modes,
                                                    std::uint64_t seed);

/// The same function with the lift as first mode, normalised like the others: Eq. 30 to the letter. For a
/// lift that grows with time without changing its shape.
[[nodiscard]] reduction::SeparatedModel with_lift_as_mode(const reduction::SeparatedModel& canonical);

}  // namespace knothe::reproduction
