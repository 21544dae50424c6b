#pragma once
/// @file Surface meshes made elsewhere: Gmsh (.msh, ASCII, formats 2.2 and 4.1) and VTK (.vtu).
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace knothe::files {

/// Linear triangles and quadrilaterals, in the file's order, with the nodes that they use. Points, lines and
/// volumes of the file are left out.
struct SurfaceMesh {
  std::vector<double> points;                      ///< [n, 3], in the file's unit
  std::vector<std::array<std::int64_t, 4>> cells;  ///< corners round the cell; a triangle's fourth is −1
};

/// Reads by the name's ending. VTU: ASCII, base64 or raw, also compressed by zlib; one piece; little-endian.
/// Errors: DataError "file:line:column: error: …" that says what to save differently: for another ending, a
/// damaged file, binary Gmsh files, elements of higher order, a file without surface elements.
[[nodiscard]] SurfaceMesh read_surface_mesh(const std::string& path);

/// The same of a file's content; `path` is for messages.
[[nodiscard]] SurfaceMesh parse_gmsh(const std::string& text, const std::string& path);
[[nodiscard]] SurfaceMesh parse_vtu(const std::string& text, const std::string& path);

/// Keeps of `points` [n, 3] those that the cells use, in their order, and renumbers them.
[[nodiscard]] SurfaceMesh with_used_points(const std::vector<double>& points,
                                           std::vector<std::array<std::int64_t, 4>> cells);

}  // namespace knothe::files
