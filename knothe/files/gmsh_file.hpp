#pragma once
/// @file Gmsh's meshes: .msh, ASCII, formats 2.2 and 4.1.
#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace knothe::files {

/// Gmsh's element types of first order, by its numbers for them.
enum class GmshType { line = 1, triangle, quadrangle, tetrahedron, hexahedron, prism, pyramid, point = 15 };

struct GmshElement {
  std::int64_t tag;
  GmshType type;
  std::array<std::int64_t, 8> nodes;  ///< indices of nodes, in Gmsh's order; −1 behind the last
  std::vector<int> groups;            ///< physical tags
  [[nodiscard]] int dimension() const;
  [[nodiscard]] const char* type_name() const;
};

/// What a file holds, in its order. Format 2.2 repeats an element for each of its groups.
struct GmshFile {
  std::vector<double> points;  ///< [n, 3], in the file's unit
  std::vector<GmshElement> elements;
  std::map<std::pair<int, int>, std::string> group_names;  ///< by (dimension, physical tag)
};

/// `path` is for messages, `purpose` says in them what elements are taken for ("image correlation takes
/// linear triangles"). Errors: DataError "path:line:column: error: …" for binary files, other formats, a
/// damaged or truncated file, coordinates that are not finite, elements of higher order.
[[nodiscard]] GmshFile parse_gmsh_file(const std::string& text, const std::string& path, const char* purpose);

}  // namespace knothe::files
