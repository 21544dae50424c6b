#include "knothe/offline/mesh/hexahedron_mesh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::offline {
namespace {

/// For every corner of a hexahedron in VTK's order, its three neighbours in right-handed order.
constexpr int k_neighbours[8][3] = {{1, 3, 4}, {2, 0, 5}, {3, 1, 6}, {0, 2, 7},
                                    {7, 5, 0}, {4, 6, 1}, {5, 7, 2}, {6, 4, 3}};

/// Six times the volume of the corner's tetrahedron, divided by its edges' lengths: 1 for a cube.
double corner_quality(const HexahedronMesh& mesh, std::int64_t cell, int corner) {
  const auto* nodes = &mesh.cells[8 * cell];
  std::array<std::array<double, 3>, 3> edges;
  double lengths = 1;
  for (int k = 0; k < 3; ++k) {
    double square = 0;
    for (int c = 0; c < 3; ++c) {
      edges[k][c] = mesh.points[3 * nodes[k_neighbours[corner][k]] + c] - mesh.points[3 * nodes[corner] + c];
      square += edges[k][c] * edges[k][c];
    }
    lengths *= std::sqrt(square);
  }
  const auto& [a, b, c] = edges;
  const double volume = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
                        a[2] * (b[0] * c[1] - b[1] * c[0]);
  return lengths > 0 ? volume / lengths : 0;
}

void check_cell(const HexahedronMesh& mesh, std::int64_t cell, const std::string& source) {
  const std::int64_t name = mesh.names.empty() ? cell : mesh.names[cell];
  const auto* nodes = &mesh.cells[8 * cell];
  for (int a = 0; a < 8; ++a)
    if (nodes[a] < 0 || nodes[a] >= mesh.node_count())
      throw DataError(fmt::format("{}: element {} uses a node that the mesh does not have", source, name));
  for (int corner = 0; corner < 8; ++corner) {
    const double quality = corner_quality(mesh, cell, corner);
    if (!(quality > 1e-8)) {
      const auto centre = mesh.cell_centre(cell);
      throw DataError(fmt::format(
          "{}: element {} (centre x = {:.6g}, y = {:.6g}, z = {:.6g} m) is {}: its Jacobian is not positive "
          "at corner {}; its nodes must go counter-clockwise round the lower face seen from inside, then "
          "round the upper one",
          source, name, centre[0], centre[1], centre[2], quality < -1e-8 ? "inverted" : "flat", corner));
    }
  }
}

/// Every cell must be reached from the first one through faces: what hangs on an edge or a node can turn, and
/// what hangs on nothing can fly away.
void check_connected(const HexahedronMesh& mesh, const std::string& source) {
  using Face = std::array<std::int64_t, 4>;
  constexpr int k_faces[6][4] = {{0, 1, 2, 3}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                 {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
  std::vector<std::pair<Face, std::int64_t>> faces;
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell)
    for (const auto& corners : k_faces) {
      Face face;
      for (std::size_t k = 0; k < 4; ++k) face[k] = mesh.cells[8 * cell + corners[k]];
      std::sort(face.begin(), face.end());
      faces.emplace_back(face, cell);
    }
  std::sort(faces.begin(), faces.end());
  std::vector<std::int64_t> leader(mesh.cell_count());  // union-find: the smallest cell of each part
  std::iota(leader.begin(), leader.end(), 0);
  const auto find = [&](std::int64_t cell) {
    while (leader[cell] != cell) cell = leader[cell] = leader[leader[cell]];
    return cell;
  };
  for (Index i = 1; i < std::ssize(faces); ++i) {
    if (faces[i].first != faces[i - 1].first) continue;
    const auto [low, high] = std::minmax({find(faces[i].second), find(faces[i - 1].second)});
    leader[high] = low;
  }
  std::int64_t parts = 0, other = 0;
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    if (leader[cell] != cell) continue;
    if (++parts == 2) other = cell;
  }
  if (parts == 1) return;
  const auto centre = mesh.cell_centre(other);
  throw DataError(fmt::format(
      "{}: the mesh is in {} parts that share no face: element {} (centre x = {:.6g}, y = {:.6g}, z = {:.6g} "
      "m) is not connected with element {}; nodes at the same place must be one node (in Gmsh: Coherence)",
      source, parts, mesh.names.empty() ? other : mesh.names[other], centre[0], centre[1], centre[2],
      mesh.names.empty() ? 0 : mesh.names[0]));
}

}  // namespace

std::array<double, 3> HexahedronMesh::cell_centre(std::int64_t cell) const {
  std::array<double, 3> centre{};
  for (int a = 0; a < 8; ++a)
    for (int c = 0; c < 3; ++c) centre[c] += points[3 * cells[8 * cell + a] + c] / 8;
  return centre;
}

void find_crack_mouth(HexahedronMesh& mesh) {
  double lowest = std::numeric_limits<double>::max(), outermost = -lowest;
  for (std::int64_t n = 0; n < mesh.node_count(); ++n)
    outermost = std::max(outermost, mesh.points[3 * n + 2]);
  constexpr double k_near = 1e-7;
  for (std::int64_t n = 0; n < mesh.node_count(); ++n)
    if (mesh.points[3 * n + 2] > outermost - k_near) lowest = std::min(lowest, mesh.points[3 * n + 1]);
  double left = -std::numeric_limits<double>::max(), right = -left;
  for (std::int64_t n = 0; n < mesh.node_count(); ++n) {
    const double x = mesh.points[3 * n];
    if (mesh.points[3 * n + 2] < outermost - k_near || mesh.points[3 * n + 1] > lowest + k_near) continue;
    if (x < -k_near && x > left) {
      left = x;
      mesh.mouth_left = n;
    }
    if (x > k_near && x < right) {
      right = x;
      mesh.mouth_right = n;
    }
  }
}

void validate(const HexahedronMesh& mesh, const std::string& source) {
  if (mesh.cell_count() == 0) throw DataError(source + ": the mesh has no hexahedra");
  std::vector<char> used(mesh.node_count(), 0);
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    check_cell(mesh, cell, source);
    for (int a = 0; a < 8; ++a) used[mesh.cells[8 * cell + a]] = 1;
  }
  const auto unused = std::find(used.begin(), used.end(), 0);
  if (unused != used.end())
    throw DataError(
        fmt::format("{}: node {} (counted from 0) belongs to no hexahedron", source, unused - used.begin()));
  check_connected(mesh, source);
  const auto require = [&](const NodeSet& set, const char* name) {
    if (set.empty()) throw DataError(fmt::format("{}: no node belongs to \"{}\"", source, name));
  };
  require(mesh.support_left, "support_left");
  require(mesh.support_right, "support_right");
  require(mesh.load, "load");
  require(mesh.symmetry, "symmetry");
  if (mesh.left_support == LeftSupport::left_face) require(mesh.left_face, "left_face");
}

}  // namespace knothe::offline
