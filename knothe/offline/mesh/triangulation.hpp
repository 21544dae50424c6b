#pragma once
/// @file From our meshes to deal.II's; for the translation units that include deal.II.
#include <deal.II/grid/tria.h>

#include <array>
#include <cstdint>
#include <span>

namespace knothe::offline {

/// deal.II counts a cell's vertices lexicographically, VTK and Gmsh go round.
constexpr std::array<int, 8> k_vtk_of_lexicographic = {0, 1, 3, 2, 4, 5, 7, 6};

/// Fills an empty triangulation with `points` (n × 3) and `cells` (c × 8, VTK's order). Vertices and cells
/// keep their numbers; within a cell they may be turned (consistent directions of edges). Throws DataError
/// where deal.II refuses the mesh.
void make_triangulation(std::span<const double> points, std::span<const std::int64_t> cells,
                        dealii::Triangulation<3>& triangulation);

}  // namespace knothe::offline
