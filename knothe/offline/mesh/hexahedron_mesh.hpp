#pragma once
/// @file A mesh of 8-node hexahedra with what the beam's mechanics needs to know of its places.
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "knothe/project/offline_options.hpp"

namespace knothe::offline {

using NodeSet = std::vector<std::int64_t>;  ///< node numbers, ascending

using project::LeftSupport;

/// Half of the body (z ≥ 0; z = 0 is the symmetry plane). Vertices of a cell in VTK's order: the lower face
/// (−ζ) counter-clockwise seen from +ζ, then the upper one.
struct HexahedronMesh {
  std::vector<double> points;       ///< n × 3, m
  std::vector<std::int64_t> cells;  ///< c × 8 node numbers
  std::vector<char> elastic;        ///< c; 1 where the material cannot be damaged
  std::vector<std::int64_t> names;  ///< c; the number that the mesh file gives to a cell (for messages)
  NodeSet support_left;             ///< u_y = 0 (or a spring), and u_x = 0 with LeftSupport::support_line
  NodeSet support_right;            ///< u_y = 0 (or a spring)
  NodeSet load;                     ///< u_y = -(imposed displacement)
  NodeSet symmetry;                 ///< u_z = 0
  NodeSet left_face;                ///< u_x = 0 with LeftSupport::left_face
  LeftSupport left_support = LeftSupport::support_line;
  /// Stiffness of each support line of the half body in y, N/m, shared by its nodes; 0: rigid.
  double support_stiffness = 0;
  /// Nodes left and right of the crack mouth (the notch's lower corners, outer face, or those of a Gmsh
  /// mesh's group "crack_mouth"): crack-mouth opening is the difference of their u_x. -1 if there are none.
  std::int64_t mouth_left = -1, mouth_right = -1;

  [[nodiscard]] std::int64_t node_count() const { return points.size() / 3; }
  [[nodiscard]] std::int64_t cell_count() const { return cells.size() / 8; }
  [[nodiscard]] std::array<double, 3> cell_centre(std::int64_t cell) const;
};

/// Sets `mouth_left` and `mouth_right` to the nodes nearest to x = 0 on either side, among those with the
/// smallest y of the outer face (largest z).
void find_crack_mouth(HexahedronMesh& mesh);

/// Refuses a mesh that nothing can be computed on (DataError, `source` names it in the message): a cell with
/// repeated or missing nodes, a flat or inverted cell (Jacobian not positive at a corner; named), a node that
/// belongs to no cell, an empty set of the four that must be there.
void validate(const HexahedronMesh& mesh, const std::string& source);

}  // namespace knothe::offline
