#pragma once
/// @file What perspective adds to an element between its nodes.
#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <array>
#include <memory>
#include <vector>

#include "knothe/imaging/camera/camera.hpp"
#include "knothe/imaging/mesh/image_mesh.hpp"

namespace knothe::imaging {

/// Elements that are bilinear on a surface, as a camera sees them. In its pictures they are correlated as
/// bilinear: c = P(X + u) − P(X) − Σ N_a d_a, with d_a = P(X_a + u_a) − P(X_a), is what such an element does
/// not follow. It is zero at the nodes; in between it grows with the square of the element's size and with
/// the part of u along the line of sight that differs from node to node (0.7 · 10⁻³ px for 100 px and a
/// motion of 1 px). Correlation finds d + b, with b the least-squares fit of Σ N_a b_a to c.
class ElementView {
 public:
  /// `points`: X of the nodes, one a column. Elements that have a node that was not `measured` are left out,
  /// and those that are not convex.
  ElementView(const Camera& camera, const Eigen::Matrix3Xd& points,
              const std::vector<std::array<int, 4>>& elements, const std::vector<char>& measured);

  /// b, px, 2 per node, for u, 3 per node. Errors: NumericalError where a point is behind the camera.
  [[nodiscard]] Eigen::VectorXd perspective(const Eigen::VectorXd& u) const;

 private:
  struct Place {
    std::array<int, 4> nodes;
    std::array<double, 4> on_surface, in_picture;  ///< shape functions
    Eigen::Vector2d pixel;
    double area;  ///< px²
  };
  [[nodiscard]] std::vector<Place> places_of(const std::array<int, 4>& nodes) const;

  Camera camera_;
  Eigen::Matrix3Xd points_;
  ImageMesh seen_;
  std::vector<Place> places_;
  std::shared_ptr<const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>> fit_;
};

}  // namespace knothe::imaging
