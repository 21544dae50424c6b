#pragma once
/// @file Which cells LATIN-PGD must no longer take as elastic.
#include <span>
#include <vector>

#include "knothe/offline/latin/latin_basis.hpp"

namespace knothe::offline {

struct Activation {
  std::vector<std::int64_t> joining;  ///< cells that wait and whose Y is above `fraction` Y₀ somewhere
  std::vector<int> missed;  ///< states in which one of them is above Y₀ itself: it should have been active
};

/// Looks at all waiting cells for states `coordinates` (working, (r + 1) × n) with the threshold of each.
/// `expanded` holds the working modes on all dofs, n_dof × r.
[[nodiscard]] Activation find_activation(const LatinBody& body, const Eigen::MatrixXd& expanded,
                                         const Eigen::MatrixXd& coordinates,
                                         std::span<const double> thresholds, double fraction);

}  // namespace knothe::offline
