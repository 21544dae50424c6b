#pragma once
/// @file Sparse grids: many parameters by few full-order solutions (docs/explanation/reduction.md).
#include <span>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"

namespace knothe::model {

/// Which points of a tensor grid are computed, and how the others follow from them.
///
/// The nodes of an axis come in levels: its middle one, then its ends, then the middles of the gaps, again
/// and again. A point of the tensor grid belongs to the sparse grid if the levels of its nodes add up to at
/// most `level`. Between its points the combination technique interpolates (M. Griebel, M. Schneider, C.
/// Zenger 1992; V. Barthelmann, E. Novak, K. Ritter, Adv. Comput. Math. 12 (2000)): the sum, with signs, of
/// the splines on all small tensor grids in it. It meets the computed points exactly, and with `level` as
/// large as it can be it is the tensor grid.
struct SparseGrid {
  std::vector<std::size_t> points;  ///< computed; indices of the tensor grid (last axis fastest), ascending
  std::vector<std::size_t> others;  ///< the rest, ascending
  std::vector<double> weights;      ///< [others][points]
};

/// Level of each node of an axis of `nodes` nodes.
[[nodiscard]] std::vector<int> node_levels(std::size_t nodes);
/// The level at which the sparse grid is the tensor grid.
[[nodiscard]] int finest_level(std::span<const Axis> axes);
/// UsageError if `level` is negative.
[[nodiscard]] SparseGrid sparse_grid(std::span<const Axis> axes, int level);
/// Sets values and outputs of the other points. Those of the computed ones must be there.
void interpolate_others(const SparseGrid& grid, Snapshots& snapshots);

}  // namespace knothe::model
