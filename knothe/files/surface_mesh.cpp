#include "knothe/files/surface_mesh.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/gmsh_file.hpp"
#include "knothe/files/text_position.hpp"

namespace knothe::files {

SurfaceMesh with_used_points(const std::vector<double>& points,
                             std::vector<std::array<std::int64_t, 4>> cells) {
  std::vector<std::int64_t> number(points.size() / 3, -1);
  for (const auto& cell : cells)
    for (const std::int64_t node : cell)
      if (node >= 0) number[node] = 0;
  SurfaceMesh mesh{{}, std::move(cells)};
  std::int64_t next = 0;
  for (Index i = 0; i < std::ssize(number); ++i) {
    if (number[i] < 0) continue;
    number[i] = next++;
    mesh.points.insert(mesh.points.end(), {points[3 * i], points[3 * i + 1], points[3 * i + 2]});
  }
  for (auto& cell : mesh.cells)
    for (std::int64_t& node : cell)
      if (node >= 0) node = number[node];
  return mesh;
}

SurfaceMesh parse_gmsh(const std::string& text, const std::string& path) {
  const GmshFile file =
      parse_gmsh_file(text, path, "image correlation takes linear triangles and quadrilaterals");
  std::vector<std::array<std::int64_t, 4>> cells;
  for (const GmshElement& element : file.elements)
    if (element.dimension() == 2)
      cells.push_back({element.nodes[0], element.nodes[1], element.nodes[2], element.nodes[3]});
  if (cells.empty())
    fail_at_offset(path, text, text.size(),
                   "the file has no triangles or quadrilaterals: save the surface's mesh too (Mesh.SaveAll = "
                   "1, or make it a physical surface)");
  return with_used_points(file.points, std::move(cells));
}

SurfaceMesh read_surface_mesh(const std::string& path) {
  const bool vtu = path.ends_with(".vtu");
  if (!vtu && !path.ends_with(".msh"))
    throw DataError(fmt::format("{}: error: a mesh is read from Gmsh (.msh) and VTK (.vtu) files", path));
  std::string text;
  try {
    text = read_text(path);
  } catch (const IoError& error) {
    throw DataError(error.what());
  }
  return vtu ? parse_vtu(text, path) : parse_gmsh(text, path);
}

}  // namespace knothe::files
