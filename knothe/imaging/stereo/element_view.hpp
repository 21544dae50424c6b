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

/// Elements that are bilinear on a surface, in the picture of a camera in which they are correlated as
/// bilinear with another picture: that of another camera, or of the moved surface. P the camera of that and X
/// the surface's place in it, c = P(X) − Σ N_a P(X_a) is what such an element does not follow. It is zero at
/// the nodes; in between it grows with the square of the element's size and with how much the ratio of the
/// two depths differs from node to node: 0.1 px for 100 px and two cameras 25° apart, 10⁻³ px for a motion of
/// 1 px. Correlation finds P(X_a) + b_a, with b the least-squares fit of Σ N_a b_a to c.
class ElementView {
 public:
  /// `points`: of the nodes, one a column, as `camera` sees them. Elements that have a node that was not
  /// `measured` are left out, and those that are not convex.
  ElementView(const Camera& camera, const Eigen::Matrix3Xd& points,
              const std::vector<std::array<int, 4>>& elements, const std::vector<char>& measured);

  /// b, px, 2 per node, in the other picture, where the nodes are at `points`. Errors: NumericalError where
  /// one is behind the camera.
  [[nodiscard]] Eigen::VectorXd perspective(const Camera& other, const Eigen::Matrix3Xd& points) const;

 private:
  struct Place {
    std::array<int, 4> nodes;
    std::array<double, 4> on_surface, in_picture;  ///< shape functions
    double area;                                   ///< px²
  };
  std::vector<Place> places_;
  std::shared_ptr<const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>> fit_;
};

}  // namespace knothe::imaging
