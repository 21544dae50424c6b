#pragma once
/// @file Where a tensor grid of parameters is too coarse.
#include <optional>
#include <span>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"

namespace knothe::model {

/// An interior node that the splines through the others miss most.
struct WeakNode {
  std::size_t axis = 0, node = 0;
  double surplus = 0;  ///< largest |u − spline through the other nodes of the line|, in the field's unit
};
/// Leaves out each interior node of each axis in turn; the largest miss at the dofs `dofs` (all if empty),
/// over all steps and all lines of the grid along that axis. Nothing if no axis has three nodes.
[[nodiscard]] std::optional<WeakNode> weakest_node(const Snapshots& snapshots,
                                                   std::span<const std::size_t> dofs);

/// The axes with a node more in the middle of the two intervals beside the weak node: old nodes stay, so that
/// their solutions need not be computed again.
[[nodiscard]] std::vector<Axis> refined(std::vector<Axis> axes, const WeakNode& node);

}  // namespace knothe::model
