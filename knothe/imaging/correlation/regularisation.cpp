#include "knothe/imaging/correlation/regularisation.hpp"

#include <map>

#include "knothe/base/index.hpp"

namespace knothe::imaging {

namespace {

using Sparse = Eigen::SparseMatrix<double>;
using Entries = std::vector<Eigen::Triplet<double>>;

Sparse matrix_of(const Entries& entries, int size) {
  Sparse matrix(size, size);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

ShapeFunctions shape_of(const ImageMesh& mesh, const std::array<int, 4>& nodes) {
  const std::size_t first = nodes[0];
  return mesh.shape_functions(nodes, mesh.x[first], mesh.y[first]);
}

/// Nodes all around which there are elements that carry.
std::vector<char> inner_nodes(const ImageMesh& mesh, const std::vector<char>& carries) {
  std::map<std::array<int, 2>, int> edges;
  std::vector<char> inside(mesh.x.size(), 0);
  const auto each_edge = [&](const auto& visit) {
    for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
      const auto& nodes = mesh.elements[e];
      const int n = ImageMesh::nodes_of(nodes);
      for (int a = 0; a < n && carries[e] != 0; ++a) {
        const int p = nodes[a], q = nodes[(a + 1) % n];
        visit(std::array<int, 2>{std::min(p, q), std::max(p, q)});
      }
    }
  };
  each_edge([&](const std::array<int, 2>& edge) {
    ++edges[edge];
    for (const int node : edge) inside[node] = 1;
  });
  for (const auto& [edge, count] : edges)
    if (count == 1)
      for (const int node : edge) inside[node] = 0;
  return inside;
}

}  // namespace

Sparse gradient_penalty(const ImageMesh& mesh) {
  Entries entries;
  for (const auto& nodes : mesh.elements) {
    const std::size_t n = ImageMesh::nodes_of(nodes);
    for (const auto& point : shape_of(mesh, nodes).integration_points())
      for (std::size_t a = 0; a < n; ++a)
        for (std::size_t b = 0; b < n; ++b) {
          const auto &ga = point.gradients[a], &gb = point.gradients[b];
          const double value = point.weight * (ga[0] * gb[0] + ga[1] * gb[1]);
          for (int k = 0; k < 2; ++k) entries.emplace_back(2 * nodes[a] + k, 2 * nodes[b] + k, value);
        }
  }
  return matrix_of(entries, 2 * mesh.node_count());
}

Sparse equilibrium_gap_penalty(const ImageMesh& mesh, const std::vector<char>& carries,
                               double poisson_ratio) {
  const double along = 2 / (1 - poisson_ratio), across = along * poisson_ratio;  // C₁₁, C₁₂ of plane stress
  const std::vector<char> inside = inner_nodes(mesh, carries);
  std::vector<double> area(mesh.x.size(), 0);
  Entries entries;
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    if (carries[e] == 0) continue;
    const auto& nodes = mesh.elements[e];
    const std::size_t n = ImageMesh::nodes_of(nodes);
    const ShapeFunctions shape = shape_of(mesh, nodes);
    for (std::size_t a = 0; a < n; ++a) area[nodes[a]] += shape.area() / n;
    for (const auto& point : shape.integration_points())
      for (std::size_t a = 0; a < n; ++a) {
        if (inside[nodes[a]] == 0) continue;  // no equation of this node
        for (std::size_t b = 0; b < n; ++b) {
          const auto [ax, ay] = point.gradients[a];
          const auto [bx, by] = point.gradients[b];
          const double w = point.weight;
          const int row = 2 * nodes[a], column = 2 * nodes[b];
          entries.emplace_back(row, column, w * (along * ax * bx + ay * by));
          entries.emplace_back(row, column + 1, w * (across * ax * by + ay * bx));
          entries.emplace_back(row + 1, column, w * (across * ay * bx + ax * by));
          entries.emplace_back(row + 1, column + 1, w * (along * ay * by + ax * bx));
        }
      }
  }
  const Sparse stiffness = matrix_of(entries, 2 * mesh.node_count());
  Eigen::VectorXd weight = Eigen::VectorXd::Zero(2 * mesh.node_count());
  for (int a = 0; a < mesh.node_count(); ++a)
    if (area[a] > 0) weight.segment<2>(2 * a).setConstant(1 / area[a]);
  const Sparse weighted = weight.asDiagonal() * stiffness;
  return stiffness.transpose() * weighted;
}

}  // namespace knothe::imaging
