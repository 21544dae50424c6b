#pragma once
/// @file Interpolation inside an element: isoparametric shape functions and the inverse of their map.
///
/// Source: T. J. R. Hughes, The Finite Element Method, 2000, ch. 3. Vertices in VTK's order.
#include <Eigen/Core>
#include <optional>
#include <string>

#include "knothe/base/index.hpp"

namespace knothe::model {

/// Vertex coordinates, one column per node of the element.
using ElementNodes = Eigen::Matrix3Xd;

/// Triangle, quadrilateral, tetrahedron or hexahedron.
struct ElementFamily;

/// A cell type of VTK that can be interpolated on: linear, or quadratic with a node in the middle of each
/// edge (serendipity).
class ReferenceElement {
 public:
  /// VTK's name, e.g. "VTK_HEXAHEDRON", "VTK_QUADRATIC_TETRA" (case and the prefix do not matter); nothing
  /// for a type not known here.
  [[nodiscard]] static std::optional<ReferenceElement> named(const std::string& vtk_name);

  [[nodiscard]] Index nodes() const;
  [[nodiscard]] Index dimension() const;  ///< 2 or 3 reference coordinates
  /// N(ξ), one per node; their sum is 1.
  [[nodiscard]] Eigen::VectorXd shape(const Eigen::Vector3d& xi) const;
  /// ∂N/∂ξ, nodes × dimension.
  [[nodiscard]] Eigen::MatrixXd shape_derivatives(const Eigen::Vector3d& xi) const;
  /// The point of the reference element nearest to ξ, by clamping.
  [[nodiscard]] Eigen::Vector3d clamp(const Eigen::Vector3d& xi) const;
  [[nodiscard]] Eigen::Vector3d centre() const;

  /// The weights N(ξ) of the nodes at `point`, if the element holds it to within `tolerance` metres.
  [[nodiscard]] std::optional<Eigen::VectorXd> weights_at(const ElementNodes& x, const Eigen::Vector3d& point,
                                                          double tolerance) const;

 private:
  ReferenceElement(const ElementFamily& family, bool quadratic) : family_(&family), quadratic_(quadratic) {}

  const ElementFamily* family_;
  bool quadratic_;
};

}  // namespace knothe::model
