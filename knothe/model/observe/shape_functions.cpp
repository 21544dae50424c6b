#include "knothe/model/observe/shape_functions.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cctype>

#include "knothe/base/index.hpp"

namespace knothe::model {

namespace {

/// Corners of the reference cube (and, its first four, of the square) in VTK's cyclic order.
constexpr std::array<std::array<double, 3>, 8> k_corners = {
    {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1}, {-1, -1, 1}, {1, -1, 1}, {1, 1, 1}, {-1, 1, 1}}};

}  // namespace

std::optional<ReferenceElement> ReferenceElement::named(const std::string& vtk_name) {
  std::string name;
  for (const char c : vtk_name) name += static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  if (name.rfind("VTK_", 0) == 0) name.erase(0, 4);
  if (name == "TRIANGLE") return ReferenceElement(Kind::triangle);
  if (name == "QUAD") return ReferenceElement(Kind::quad);
  if (name == "TETRA") return ReferenceElement(Kind::tetra);
  if (name == "HEXAHEDRON") return ReferenceElement(Kind::hexahedron);
  return std::nullopt;
}

Index ReferenceElement::nodes() const {
  switch (kind_) {
    case Kind::triangle:
      return 3;
    case Kind::quad:
      return 4;
    case Kind::tetra:
      return 4;
    case Kind::hexahedron:
      break;
  }
  return 8;
}

Index ReferenceElement::dimension() const {
  return kind_ == Kind::triangle || kind_ == Kind::quad ? 2 : 3;
}

Eigen::VectorXd ReferenceElement::shape(const Eigen::Vector3d& xi) const {
  const Index d = dimension();
  Eigen::VectorXd values(nodes());
  if (simplex()) {
    values[0] = 1.0;
    for (Index i = 0; i < d; ++i) {
      values[i + 1] = xi[i];
      values[0] -= xi[i];
    }
    return values;
  }
  for (Index k = 0; k < nodes(); ++k) {
    values[k] = 1.0;
    for (Index i = 0; i < d; ++i) values[k] *= 0.5 * (1.0 + k_corners[k][i] * xi[i]);
  }
  return values;
}

Eigen::MatrixXd ReferenceElement::shape_derivatives(const Eigen::Vector3d& xi) const {
  const Index d = dimension();
  Eigen::MatrixXd derivatives(nodes(), d);
  if (simplex()) {
    derivatives.row(0).setConstant(-1.0);
    derivatives.bottomRows(d).setIdentity();
    return derivatives;
  }
  for (Index k = 0; k < nodes(); ++k) {
    for (Index j = 0; j < d; ++j) {
      double value = 0.5 * k_corners[k][j];
      for (Index i = 0; i < d; ++i) {
        if (i != j) value *= 0.5 * (1.0 + k_corners[k][i] * xi[i]);
      }
      derivatives(k, j) = value;
    }
  }
  return derivatives;
}

Eigen::Vector3d ReferenceElement::centre() const {
  const Index d = dimension();
  Eigen::Vector3d xi = Eigen::Vector3d::Zero();
  for (Index i = 0; simplex() && i < d; ++i) xi[i] = 1.0 / (d + 1);
  return xi;
}

Eigen::Vector3d ReferenceElement::clamp(const Eigen::Vector3d& xi) const {
  if (!simplex()) return xi.cwiseMax(-1.0).cwiseMin(1.0);
  // Barycentric coordinates: the negative ones become zero, the others are scaled to sum 1.
  const Eigen::VectorXd barycentric = shape(xi).cwiseMax(0.0);
  Eigen::Vector3d inside = Eigen::Vector3d::Zero();
  for (Index i = 0; i < dimension(); ++i) inside[i] = barycentric[i + 1] / barycentric.sum();
  return inside;
}

std::optional<Eigen::VectorXd> ReferenceElement::weights_at(const ElementNodes& x,
                                                            const Eigen::Vector3d& point,
                                                            double tolerance) const {
  const Eigen::Vector3d low = x.rowwise().minCoeff(), high = x.rowwise().maxCoeff();
  if (((low.array() - tolerance) > point.array()).any() ||
      ((high.array() + tolerance) < point.array()).any()) {
    return std::nullopt;
  }
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
