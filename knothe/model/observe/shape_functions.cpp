#include "knothe/model/observe/shape_functions.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::model {

/// The edges are in VTK's order of their middles.
struct ElementFamily {
  std::string_view name;
  bool simplex;
  Index dimension, corners;
  std::vector<std::array<Index, 2>> edges;
};

namespace {

/// Corners of the reference cube (and, its first four, of the square) in VTK's cyclic order.
constexpr std::array<std::array<double, 3>, 8> k_corners = {
    {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1}, {-1, -1, 1}, {1, -1, 1}, {1, 1, 1}, {-1, 1, 1}}};

const std::array<ElementFamily, 4>& families() {
  static const std::array<ElementFamily, 4> all = {
      {{"TRIANGLE", true, 2, 3, {{0, 1}, {1, 2}, {2, 0}}},
       {"QUAD", false, 2, 4, {{0, 1}, {1, 2}, {2, 3}, {3, 0}}},
       {"TETRA", true, 3, 4, {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}}},
       {"HEXAHEDRON",
        false,
        3,
        8,
        {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {4, 5}, {5, 6}, {6, 7}, {7, 4}, {0, 4}, {1, 5}, {2, 6}, {3, 7}}}}};
  return all;
}

/// The reference coordinates of a node of a square or cube: ±1, and 0 along the edge that it is in the middle
/// of.
Eigen::Vector3d node_of_box(const ElementFamily& family, Index node) {
  const auto corner = [](Index k) { return Eigen::Map<const Eigen::Vector3d>(k_corners[k].data()); };
  if (node < family.corners) return corner(node);
  const auto& [a, b] = family.edges[node - family.corners];
  return 0.5 * (corner(a) + corner(b));
}

/// A product of one factor a coordinate, and its derivatives.
struct Product {
  Eigen::Vector3d factors = Eigen::Vector3d::Ones(), derivatives = Eigen::Vector3d::Zero();

  [[nodiscard]] double without(Index j) const { return factors[(j + 1) % 3] * factors[(j + 2) % 3]; }
  [[nodiscard]] double value() const { return factors.prod(); }
  [[nodiscard]] double derivative(Index j) const { return derivatives[j] * without(j); }
};

/// ½(1 ± ξ_i), and 1 − ξ_i² along the edge that `node` is in the middle of.
Product product_of_box(const Eigen::Vector3d& node, const Eigen::Vector3d& xi, Index dimension) {
  Product product;
  for (Index i = 0; i < dimension; ++i) {
    const bool middle = node[i] == 0;
    product.factors[i] = middle ? 1 - xi[i] * xi[i] : 0.5 * (1 + node[i] * xi[i]);
    product.derivatives[i] = middle ? -2 * xi[i] : 0.5 * node[i];
  }
  return product;
}

/// Barycentric coordinates of a simplex: 1 − Σξ, ξ.
Eigen::VectorXd barycentric_of(const Eigen::Vector3d& xi, Index dimension) {
  Eigen::VectorXd values(dimension + 1);
  values << 1 - xi.head(dimension).sum(), xi.head(dimension);
  return values;
}

}  // namespace

std::optional<ReferenceElement> ReferenceElement::named(const std::string& vtk_name) {
  std::string name;
  for (const char c : vtk_name) name += static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  if (name.starts_with("VTK_")) name.erase(0, 4);
  const bool quadratic = name.starts_with("QUADRATIC_");
  if (quadratic) name.erase(0, 10);
  for (const ElementFamily& family : families())
    if (family.name == name) return ReferenceElement(family, quadratic);
  return std::nullopt;
}

Index ReferenceElement::nodes() const {
  return family_->corners + (quadratic_ ? std::ssize(family_->edges) : 0);
}

Index ReferenceElement::dimension() const {
  return family_->dimension;
}

Eigen::VectorXd ReferenceElement::shape(const Eigen::Vector3d& xi) const {
  const Index d = dimension();
  Eigen::VectorXd values(nodes());
  if (family_->simplex) {
    const Eigen::VectorXd l = barycentric_of(xi, d);
    if (!quadratic_) return l;
    values.head(d + 1) = l.array() * (2 * l.array() - 1);
    for (Index k = d + 1; const auto& [a, b] : family_->edges) values[k++] = 4 * l[a] * l[b];
    return values;
  }
  for (Index k = 0; k < nodes(); ++k) {
    const Eigen::Vector3d node = node_of_box(*family_, k);
    values[k] = product_of_box(node, xi, d).value();
    if (quadratic_ && k < family_->corners) values[k] *= node.head(d).dot(xi.head(d)) - (d - 1);
  }
  return values;
}

Eigen::MatrixXd ReferenceElement::shape_derivatives(const Eigen::Vector3d& xi) const {
  const Index d = dimension();
  Eigen::MatrixXd derivatives(nodes(), d);
  if (family_->simplex) {
    Eigen::MatrixXd dl(d + 1, d);
    dl << Eigen::RowVectorXd::Constant(d, -1), Eigen::MatrixXd::Identity(d, d);
    if (!quadratic_) return dl;
    const Eigen::VectorXd l = barycentric_of(xi, d);
    for (Index k = 0; k <= d; ++k) derivatives.row(k) = (4 * l[k] - 1) * dl.row(k);
    for (Index k = d + 1; const auto& [a, b] : family_->edges)
      derivatives.row(k++) = 4 * (l[a] * dl.row(b) + l[b] * dl.row(a));
    return derivatives;
  }
  for (Index k = 0; k < nodes(); ++k) {
    const Eigen::Vector3d node = node_of_box(*family_, k);
    const Product product = product_of_box(node, xi, d);
    const bool bubble = quadratic_ && k < family_->corners;
    const double factor = bubble ? node.head(d).dot(xi.head(d)) - (d - 1) : 1;
    for (Index j = 0; j < d; ++j) {
      derivatives(k, j) = factor * product.derivative(j);
      if (bubble) derivatives(k, j) += node[j] * product.value();
    }
  }
  return derivatives;
}

Eigen::Vector3d ReferenceElement::centre() const {
  const Index d = dimension();
  Eigen::Vector3d xi = Eigen::Vector3d::Zero();
  if (family_->simplex) xi.head(d).setConstant(1.0 / (d + 1));
  return xi;
}

Eigen::Vector3d ReferenceElement::clamp(const Eigen::Vector3d& xi) const {
  if (!family_->simplex) return xi.cwiseMax(-1.0).cwiseMin(1.0);
  // Barycentric coordinates: the negative ones become zero, the others are scaled to sum 1.
  const Eigen::VectorXd barycentric = barycentric_of(xi, dimension()).cwiseMax(0.0);
  Eigen::Vector3d inside = Eigen::Vector3d::Zero();
  for (Index i = 0; i < dimension(); ++i) inside[i] = barycentric[i + 1] / barycentric.sum();
  return inside;
}

std::optional<Eigen::VectorXd> ReferenceElement::weights_at(const ElementNodes& x,
                                                            const Eigen::Vector3d& point,
                                                            double tolerance) const {
  const Eigen::Array3d low = x.rowwise().minCoeff(), high = x.rowwise().maxCoeff();
  // A curved edge reaches beyond its nodes.
  const Eigen::Array3d margin = tolerance + (quadratic_ ? 0.25 : 0.0) * (high - low);
  if ((low - margin > point.array()).any() || (high + margin < point.array()).any()) return std::nullopt;
  // Gauss–Newton on |x(ξ) − point|²: quadratic, because the residual vanishes where the element holds the
  // point. Iterates are kept near the element, where the map of a valid element is invertible.
  Eigen::Vector3d xi = centre();
  const Index d = dimension();
  for (int iteration = 0; iteration < 50; ++iteration) {
    const Eigen::Vector3d residual = point - x * shape(xi);
    const Eigen::MatrixXd jacobian = x * shape_derivatives(xi);
    const Eigen::VectorXd step = jacobian.colPivHouseholderQr().solve(residual);
    if (!step.allFinite()) return std::nullopt;
    for (Index i = 0; i < d; ++i) xi[i] = std::clamp(xi[i] + step[i], -3.0, 3.0);
    if (step.norm() < 1e-14) break;
  }
  const Eigen::VectorXd weights = shape(clamp(xi));
  if ((x * weights - point).norm() > tolerance) return std::nullopt;
  return weights;
}

}  // namespace knothe::model
