#pragma once
/// @file LATIN-PGD started from a reduced model: the hybrid start (docs/explanation/latin.md).
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/offline/full_order/offline.hpp"

namespace knothe::offline {

/// What is known of the solution beforehand: û(x, t, p) = τ u_lift + Σ_l W_l(x) a_l(t, p) at the points that
/// are to be computed. It may be as wrong as it likes: it is a start, and what is found does not depend on it
/// but within the accuracy asked for.
struct LatinStart {
  Eigen::MatrixXd space;  ///< W, n_dof × l, orthonormal; zero where displacements are given
  std::vector<Eigen::MatrixXd> coordinates;  ///< a, for each step l × P

  [[nodiscard]] bool empty() const { return space.cols() == 0; }
};

/// The start from a model (of snapshots of a coarser grid of parameters, say) at the grid points of `axes`;
/// outside the model's box it is taken at the nearest point inside. DataError that names the model and says
/// what differs if it is not of this mesh, these steps and this elastic body, or has parameters that LATIN
/// has not.
[[nodiscard]] LatinStart start_from(const model::SeparatedModel& model, const BeamProblem& problem,
                                    const Structure& structure, const std::vector<model::Axis>& axes);

/// A number that differs when the start does.
[[nodiscard]] std::uint64_t fingerprint(const LatinStart& start);

}  // namespace knothe::offline
