#pragma once
/// @file The notched three-point bending beam of Rubio et al. 2019, §6, as a structured graded mesh.
#include <vector>

#include "knothe/offline/mesh/hexahedron_mesh.hpp"

namespace knothe::offline {

/// Geometry, supports and mesh of the beam; defaults are the paper's case. Lengths in m.
struct BeamOptions {
  double element = 0.005;  ///< element size in x and y for |x| ≤ refined_half_width
  int layers = 1;          ///< layers of elements over the half thickness
  double length = 0.84;
  double height = 0.1;
  double half_thickness = 0.05;  ///< z from 0 (symmetry plane) to this (outer face)
  /// Depth of the notch at mid-span, rounded to whole elements. 0: no notch.
  double notch_depth = 0.02;
  /// Width of the notch: one element of 5 mm. Smaller elements: divided into round(width / element) columns.
  /// Larger elements: one column, and the notch is as wide as the element.
  double notch_width = 0.005;
  double support = 0.4;  ///< support lines at x = ±support, y = 0
  /// Nodes of the upper face with |x| up to this are pushed down; at least those nearest to mid-span.
  double load_half_width = 0.0075;
  double refined_half_width = 0.0525;    ///< fine mesh, and material that can be damaged, up to this |x|
  double protected_half_width = 0.0125;  ///< elements under the load up to this |x| …
  double protected_depth = 0.005;        ///< … and this depth (at least the upper row) cannot be damaged
  double growth = 1.2;                   ///< ratio of neighbouring columns outside the fine mesh
  double largest_element = 0.025;        ///< widest column outside the fine mesh
  LeftSupport left_support = LeftSupport::support_line;
  /// Stiffness of each support of the whole beam in y, N/m; 0: rigid.
  double support_stiffness = 0;
  /// The load strip stands so far to the right of mid-span, m, at most 0.01: the mesh above mid-height and
  /// beside the strip is sheared, so that the displacement is a smooth function of it. Nodes keep their
  /// numbers.
  double load_offset = 0;

  /// Throws ProjectError naming the option that makes no sense.
  void validate() const;
};

/// Planes of constant x, y and z of the beam's grid.
struct BeamGrid {
  std::vector<double> x, y, z;
  double notch_half_width = 0;  ///< as meshed
  double notch_depth = 0;       ///< as meshed
};
[[nodiscard]] BeamGrid beam_grid(const BeamOptions& options);

/// Node sets, supports and crack mouth of a mesh of that beam; the grid must have planes at x = ±support.
void mark_beam(HexahedronMesh& mesh, const BeamOptions& options);

/// The beam. Throws ProjectError for options that make no sense.
///
/// The damage law is local, so the element size is a material parameter; and a mesh with an even number of
/// columns above the notch (element = notch_width / 2) has two equal columns where the reference has one, and
/// hides it: docs/explanation/mechanics.md.
[[nodiscard]] HexahedronMesh beam_mesh(const BeamOptions& options);

}  // namespace knothe::offline
