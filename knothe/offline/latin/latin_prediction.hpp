#pragma once
/// @file What LATIN-PGD takes from a hybrid start at each window: cells, modes and first iterates.
#include <Eigen/Core>
#include <span>
#include <vector>

#include "knothe/offline/latin/latin_basis.hpp"
#include "knothe/offline/latin/latin_start.hpp"

namespace knothe::offline {

/// The start (LatinStart) seen from the active cells. With F = K W on all dofs, the elastic forces of the
/// state û are F a: they act on the cells that are damaged there, and so are active here.
class LatinPrediction {
 public:
  /// `start` must outlive this.
  LatinPrediction(const LatinStart& start, const Structure& structure);

  /// Cells that wait and are expected to be damaged, or nearly (`fraction` of the thresholds), at the end of
  /// a step.
  [[nodiscard]] std::vector<std::int64_t> joining(const LatinBody& body, int step, double imposed,
                                                  std::span<const double> thresholds, double fraction) const;
  /// Elastic forces on the active dofs, n_a × k, of the fewest modes that represent the states expected at
  /// the steps [first, last) to `allowed` (root mean square of the norm over dofs, m).
  [[nodiscard]] Eigen::MatrixXd forces(const LatinBody& body, int first, int last, double allowed) const;
  /// Working coordinates of the states expected at a step (-1: the unloaded body), r × P.
  [[nodiscard]] Eigen::MatrixXd expected(const LatinBody& body, const LatinBasis& basis, int step) const;

 private:
  const LatinStart& start_;
  Eigen::MatrixXd forces_;  ///< F, n_dof × l
};

}  // namespace knothe::offline
