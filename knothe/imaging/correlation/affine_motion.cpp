#include "knothe/imaging/correlation/affine_motion.hpp"

#include <Eigen/LU>
#include <cmath>

#include "knothe/imaging/correlation/picture_pyramid.hpp"

namespace knothe::imaging {

/// With x = a X + b on either level, a X' + b = F (a X + b) + t.
AffineMotion at_level(const AffineMotion& motion, int from, int to) {
  const auto origin = [](int level) -> Eigen::Vector2d {
    return Eigen::Vector2d::Constant(from_level(0, level));
  };
  const Eigen::Vector2d full = origin(from) + std::exp2(from) * motion.shift - motion.gradient * origin(from);
  return {motion.gradient, (motion.gradient * origin(to) + full - origin(to)) / std::exp2(to)};
}

Eigen::VectorXd nodal_displacement(const AffineMotion& motion, const ImageMesh& mesh) {
  Eigen::VectorXd displacement(2 * mesh.node_count());
  for (int a = 0; a < mesh.node_count(); ++a) {
    const Eigen::Vector2d x(mesh.x[a], mesh.y[a]);
    displacement.segment<2>(2 * a) = motion.moved(x) - x;
  }
  return displacement;
}

AffineMotion fitted_motion(const Eigen::Matrix2Xd& from, const Eigen::Matrix2Xd& to) {
  AffineMotion motion;
  if (from.cols() == 0) return motion;
  const Eigen::Vector2d middle = from.rowwise().mean(), moved = to.rowwise().mean();
  const Eigen::Matrix2Xd x = from.colwise() - middle;
  const Eigen::Matrix2d normal = x * x.transpose();
  if (!(normal.determinant() > 1e-12 * normal.squaredNorm())) return motion;
  motion.gradient = (to.colwise() - moved) * x.transpose() * normal.inverse();
  motion.shift = moved - motion.gradient * middle;
  return motion;
}

AffineMotion mean_motion(const ImageMesh& mesh, const Eigen::VectorXd& displacement) {
  Eigen::Matrix2Xd nodes(2, mesh.node_count());
  for (int a = 0; a < mesh.node_count(); ++a) nodes.col(a) << mesh.x[a], mesh.y[a];
  return fitted_motion(nodes, nodes + displacement.reshaped(2, nodes.cols()));
}

}  // namespace knothe::imaging
