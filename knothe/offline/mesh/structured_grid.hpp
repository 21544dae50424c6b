#pragma once
/// @file Structured grids of hexahedra: planes of constant x, y, z, with graded distances.
#include <functional>
#include <span>
#include <vector>

#include "knothe/offline/mesh/hexahedron_mesh.hpp"

namespace knothe::offline {

/// Positions from `from` to `to` (both included, increasing or decreasing): intervals grow from `first` by
/// `growth` up to `largest`, then all are stretched a little so that the last position is `to` exactly.
[[nodiscard]] std::vector<double> graded_positions(double from, double to, double first, double growth,
                                                   double largest);

/// `count` equal intervals from `from` to `to`: count + 1 positions.
[[nodiscard]] std::vector<double> uniform_positions(double from, double to, std::size_t count);

/// Points and cells of the grid, where `is_inside(centre)` says so; nodes of no cell are left out. Node
/// numbers run through y, then z, then x, so that a plane of constant x is contiguous. No node sets.
[[nodiscard]] HexahedronMesh structured_grid(
    std::span<const double> x, std::span<const double> y, std::span<const double> z,
    const std::function<bool(const std::array<double, 3>&)>& is_inside);

/// Numbers of the nodes whose position fulfils `condition(x, y, z)`.
[[nodiscard]] NodeSet nodes_where(const HexahedronMesh& mesh,
                                  const std::function<bool(double, double, double)>& condition);

}  // namespace knothe::offline
