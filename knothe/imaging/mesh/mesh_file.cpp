#include "knothe/imaging/mesh/mesh_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/surface_mesh.hpp"

namespace knothe::imaging {

ImageMesh read_image_mesh(const std::string& path, const std::optional<PictureFrame>& frame) {
  files::SurfaceMesh file = files::read_surface_mesh(path);
  const std::size_t axis = frame && frame->view == View::bottom ? 1 : 2;  // across the face
  double low = file.points[axis], high = low, reach = 0;
  for (std::size_t i = 0; i < file.points.size(); i += 3) {
    low = std::min(low, file.points[i + axis]), high = std::max(high, file.points[i + axis]);
    for (std::size_t k = 0; k < 3; ++k) reach = std::max(reach, std::abs(file.points[i + k]));
  }
  const double flat = 1e-6 * reach;
  if (high - low > flat) {
    if (!frame)
      throw DataError(fmt::format(
          "{}: error: z of the mesh goes from {} to {}: a mesh in pixels is plane; save the surface "
          "that the camera sees alone, or give a scale and \"dic.mesh_unit\" = \"m\"",
          path, low, high));
    std::erase_if(file.cells, [&](const auto& cell) {
      return std::any_of(cell.begin(), cell.end(), [&](std::int64_t node) {
        return node >= 0 && std::abs(file.points[3 * node + axis] - frame->plane) > flat;
      });
    });
    if (file.cells.empty())
      throw DataError(fmt::format(
          "{}: error: none of the mesh's elements lies in the plane {} = {} m that the camera sees: "
          "set \"dic.plane\"",
          path, axis == 2 ? "z" : "y", frame->plane));
  }
  ImageMesh mesh;
  std::vector<int> number(file.points.size() / 3, -1);
  for (const auto& cell : file.cells) {
    std::array<int, 4> element{-1, -1, -1, -1};
    for (std::size_t a = 0; a < 4 && cell[a] >= 0; ++a) {
      const std::size_t node = cell[a];
      if (number[node] < 0) {
        number[node] = mesh.node_count();
        const double* p = file.points.data() + 3 * node;
        const auto pixel =
            frame ? frame->picture_point({p[0], p[1], p[2]}) : std::array<double, 2>{p[0], p[1]};
        mesh.x.push_back(pixel[0]), mesh.y.push_back(pixel[1]);
      }
      element[a] = number[node];
    }
    mesh.elements.push_back(element);
  }
  return mesh;
}

}  // namespace knothe::imaging
