#pragma once
/// @file Meshes from Gmsh.
#include <string>

#include "knothe/offline/mesh/hexahedron_mesh.hpp"

namespace knothe::offline {

/// Reads a mesh of 8-node hexahedra from an ASCII .msh file, format 2.2 or 4.1, in metres: x along the beam,
/// y up, half of the body from the symmetry plane z = 0. Physical groups (Gmsh: "Physical Volume("elastic") =
/// …") say what is what:
///
/// | group | dimension | meaning |
/// | --- | --- | --- |
/// | elastic | volume | cells that cannot be damaged: at least those under the load and at the supports |
/// | support_left | any below | u_y = 0, and u_x = 0 with LeftSupport::support_line |
/// | support_right | any below | u_y = 0 |
/// | load | any below | u_y is prescribed |
/// | symmetry | surface | u_z = 0 |
/// | left_face | surface | u_x = 0; needed with LeftSupport::left_face only |
///
/// Other groups are volumes that can be damaged, or are ignored. Errors, all DataError naming the file: not
/// readable, binary, another format, a group missing (named), cells other than hexahedra, an inverted cell
/// (named by its number in the file), truncated file.
[[nodiscard]] HexahedronMesh read_gmsh_mesh(const std::string& path,
                                            LeftSupport left_support = LeftSupport::support_line);

}  // namespace knothe::offline
