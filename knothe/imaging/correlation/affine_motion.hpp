#pragma once
/// @file A motion x ↦ F x + t: the large part of one, about which a correlation is small. Private to the
/// room.
#include <Eigen/Core>

#include "knothe/imaging/mesh/image_mesh.hpp"

namespace knothe::imaging {

struct AffineMotion {
  Eigen::Matrix2d gradient = Eigen::Matrix2d::Identity();  ///< F
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();         ///< t, px
  [[nodiscard]] Eigen::Vector2d moved(const Eigen::Vector2d& x) const { return gradient * x + shift; }
};

/// The same motion in the pixels of another level of the pictures' pyramids.
[[nodiscard]] AffineMotion at_level(const AffineMotion& motion, int from_level_number, int to_level_number);

/// Displacements of the nodes, 2 per node.
[[nodiscard]] Eigen::VectorXd nodal_displacement(const AffineMotion& motion, const ImageMesh& mesh);

/// The motion that brings points nearest to others, by least squares; none where they lie in a line.
[[nodiscard]] AffineMotion fitted_motion(const Eigen::Matrix2Xd& from, const Eigen::Matrix2Xd& to);
/// The motion nearest to displacements of the nodes.
[[nodiscard]] AffineMotion mean_motion(const ImageMesh& mesh, const Eigen::VectorXd& displacement);

}  // namespace knothe::imaging
