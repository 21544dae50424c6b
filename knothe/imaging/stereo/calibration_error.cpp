#include "knothe/imaging/stereo/calibration_error.hpp"

#include <Eigen/SparseCholesky>

#include "knothe/base/error.hpp"

namespace knothe::imaging {
namespace {

using Factor = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>;

/// Of one camera at the nodes of a surface.
struct Derivatives {
  std::vector<Eigen::Matrix<double, 2, 3>> by_place;
  Eigen::MatrixXd by_change;  ///< 2n × 19
};

Derivatives derivatives_of(const Camera& camera, const SurfacePoints& points) {
  Derivatives d;
  d.by_change.resize(2 * points.cols(), k_camera_parameters);
  for (Index a = 0; a < points.cols(); ++a) {
    d.by_place.push_back(camera.project(points.col(a)).jacobian);
    d.by_change.middleRows<2>(2 * a) = camera.parameter_jacobian(points.col(a));
  }
  return d;
}

/// Jᵀ Π values.
Eigen::MatrixXd weighted(const Derivatives& at, const Eigen::SparseMatrix<double>& precision,
                         const Eigen::MatrixXd& values) {
  const Eigen::MatrixXd forces = precision * values;
  Eigen::MatrixXd sum(3 * std::ssize(at.by_place), values.cols());
  for (Index a = 0; a < std::ssize(at.by_place); ++a)
    sum.middleRows<3>(3 * a) = at.by_place[a].transpose() * forces.middleRows<2>(2 * a);
  return sum;
}

void factorise(Factor& factor, const Eigen::SparseMatrix<double>& normal) {
  factor.compute(normal);
  if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 0))
    throw NumericalError(
        "the cameras do not determine the surface's motion, and so not what a change of them does");
}

}  // namespace

Eigen::MatrixXd calibration_sensitivity(const std::vector<Camera>& cameras, const SurfacePoints& points,
                                        const std::vector<CameraMotion>& motions,
                                        const SurfaceMotion& found) {
  const Index n = points.cols(), count = std::ssize(cameras), size = k_camera_parameters;
  const SurfacePoints moved = points + Eigen::Map<const SurfacePoints>(found.displacement.data(), 3, n);
  std::vector<CameraMotion> rest = motions;
  for (CameraMotion& m : rest) m.displacement.setZero();
  Factor of_shape, of_motion;
  factorise(of_shape, surface_motion(cameras, points, rest).precision);
  factorise(of_motion, found.precision);
  std::vector<Derivatives> before, after;
  for (const Camera& camera : cameras)
    before.push_back(derivatives_of(camera, points)), after.push_back(derivatives_of(camera, moved));
  Eigen::MatrixXd shape(3 * n, size * count), right = Eigen::MatrixXd::Zero(3 * n, size * count);
  for (Index c = 0; c < count; ++c)
    shape.middleCols(size * c, size) =
        -of_shape.solve(weighted(before[c], motions[c].precision, before[c].by_change));
  for (Index c = 0; c < count; ++c) {
    Eigen::MatrixXd change(2 * n, size * count);
    for (Index a = 0; a < n; ++a)
      change.middleRows<2>(2 * a) =
          (after[c].by_place[a] - before[c].by_place[a]) * shape.middleRows<3>(3 * a);
    change.middleCols(size * c, size) += after[c].by_change - before[c].by_change;
    right -= weighted(after[c], motions[c].precision, change);
  }
  Eigen::MatrixXd sensitivity = of_motion.solve(right);
  for (Index a = 0; a < n; ++a)
    if (found.measured[a] == 0) sensitivity.middleRows<3>(3 * a).setZero();
  return sensitivity;
}

}  // namespace knothe::imaging
