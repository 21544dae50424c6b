#include "knothe/imaging/crack/strain.hpp"

#include <array>

#include "knothe/base/index.hpp"

namespace knothe::imaging {

namespace {

/// du/dx, du/dy, dv/dx, dv/dy of an element at its node `at`, and its area.
struct ElementGradient {
  std::array<double, 4> gradient{};
  double area = 0;
};

/// By the two edges that meet in the node: exact there, for any quadrilateral too (∂x/∂ξ is along the edge).
ElementGradient gradient_at(const ImageMesh& mesh, const Eigen::VectorXd& displacement,
                            const std::array<int, 4>& nodes, int at) {
  const int n = ImageMesh::nodes_of(nodes);
  const auto node = [&](int a) { return nodes[(a + n) % n]; };
  const auto edge = [&](int a) {
    const std::size_t p = node(at), q = node(a);
    return std::array<double, 4>{mesh.x[q] - mesh.x[p], mesh.y[q] - mesh.y[p],
                                 displacement[2 * node(a)] - displacement[2 * node(at)],
                                 displacement[2 * node(a) + 1] - displacement[2 * node(at) + 1]};
  };
  const auto a = edge(at + 1), b = edge(at - 1);
  const double det = a[0] * b[1] - a[1] * b[0];
  ElementGradient result;
  result.area = std::abs(det) * (n == 3 ? 0.5 : 1);
  for (std::size_t k = 0; k < 2; ++k) {
    result.gradient[2 * k] = (a[2 + k] * b[1] - b[2 + k] * a[1]) / det;
    result.gradient[2 * k + 1] = (a[0] * b[2 + k] - b[0] * a[2 + k]) / det;
  }
  return result;
}

}  // namespace

Eigen::MatrixXd nodal_gradients(const ImageMesh& mesh, const Eigen::VectorXd& displacement,
                                const std::vector<char>& element_valid) {
  Eigen::MatrixXd gradient = Eigen::MatrixXd::Zero(mesh.node_count(), 4);
  Eigen::VectorXd area = Eigen::VectorXd::Zero(mesh.node_count());
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    if (element_valid[e] == 0) continue;
    for (int a = 0; a < ImageMesh::nodes_of(mesh.elements[e]); ++a) {
      const auto g = gradient_at(mesh, displacement, mesh.elements[e], a);
      const int node = mesh.elements[e][a];
      for (int k = 0; k < 4; ++k) gradient(node, k) += g.area * g.gradient[k];
      area[node] += g.area;
    }
  }
  for (int a = 0; a < mesh.node_count(); ++a)
    if (area[a] > 0) gradient.row(a) /= area[a];
  return gradient;
}

Eigen::MatrixXd nodal_strains(const ImageMesh& mesh, const Eigen::VectorXd& displacement,
                              const std::vector<char>& element_valid) {
  const Eigen::MatrixXd gradient = nodal_gradients(mesh, displacement, element_valid);
  Eigen::MatrixXd strain(mesh.node_count(), 3);
  strain.col(0) = gradient.col(0);
  strain.col(1) = gradient.col(3);
  strain.col(2) = 0.5 * (gradient.col(1) + gradient.col(2));
  return strain;
}

}  // namespace knothe::imaging
