#pragma once
/// @file One face of a hexahedral mesh, coloured by a number at its nodes, in its deformed shape.
#include <array>
#include <span>
#include <string>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"
#include "knothe/report/figures/svg_figure.hpp"

namespace knothe::report {

/// The quadrilaterals of a mesh that lie in its outermost plane of constant z.
struct OuterFace {
  std::vector<std::size_t> nodes;                 ///< of the mesh, the face's own numbering is their order
  std::vector<std::array<double, 2>> points;      ///< x, y of the face's nodes, m
  std::vector<std::array<std::size_t, 4>> cells;  ///< in the face's numbering, around each quadrilateral
};

/// Errors: DataError unless the cells are hexahedra of 8 nodes whose indices exist.
[[nodiscard]] OuterFace outer_face(const model::Mesh& mesh);

/// Index of the dof with component `component` (0 x, 1 y, 2 z) at each node of the face (matched within 1e-7
/// m); -1 where the model has none.
[[nodiscard]] std::vector<std::ptrdiff_t> dofs_of_face(const OuterFace& face, const model::Dofs& dofs,
                                                       std::int64_t component);

/// The edges of the face that one cell alone has: its boundary, a notch and holes included. Two points each,
/// m.
[[nodiscard]] std::vector<std::array<std::array<double, 2>, 2>> outline(const OuterFace& face);

/// Height (px) of a plot of that width that shows the face without distortion, with room for title and colour
/// bar.
[[nodiscard]] double plot_height_of(const OuterFace& face, double plot_width);

/// Draws `value` (one per node of the face). `shift` (empty, or one per node, in m) is added to the
/// positions. The colours run over [-m, m] in blue, white and red where `value` changes sign, else over its
/// range in viridis.
[[nodiscard]] Plot mesh_plot(const std::string& title, const OuterFace& face, std::span<const double> value,
                             std::span<const std::array<double, 2>> shift, const std::string& bar_label);

}  // namespace knothe::report
