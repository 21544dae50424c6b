#include "knothe/imaging/stereo/stereo_pose.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"

namespace knothe::imaging {
namespace {

constexpr double k_max_misfit = 0.02;  // relative to the extent of the points

}  // namespace

StereoPose fit_stereo_pose(const Camera& first, const SurfacePoints& surface, const Eigen::Matrix2Xd& pixels,
                           const SurfacePoints& points, const Eigen::Vector3d& outward, double point_std) {
  const Index count = points.cols();
  if (count < 2 || pixels.cols() != count)
    throw UsageError(
        fmt::format("registration of the cameras: {} pixels and {} points; at least two of each, as many, are "
                    "needed",
                    pixels.cols(), count));
  StereoPose found;
  found.outward = outward, found.middle = points.rowwise().mean();
  const double extent = (points.colwise() - found.middle).norm();
  if (!(extent > 0)) throw UsageError("registration of the cameras: the points lie in one place");
  const Eigen::Vector3d centre = surface.rowwise().mean();
  const SurfacePoints about = surface.colwise() - centre;
  const numerics::SymmetricEigen axes(about * about.transpose());
  found.flatness = std::sqrt(std::max(0.0, axes.eigenvalues()[0]) / surface.cols());
  Eigen::Vector3d normal = axes.eigenvectors().col(0);
  // Each point and one above it: the motion is rigid in space, and tells the face from its back.
  SurfacePoints from(3, 2 * count), to(3, 2 * count);
  double pixels_per_length = 0;
  for (Index k = 0; k < count; ++k) {
    const Ray ray = first.ray(pixels.col(k));
    if (normal.dot(ray.origin - centre) < 0) normal = -normal;
    const double depth = normal.dot(centre - ray.origin) / normal.dot(ray.direction);
    to.col(k) = ray.origin + depth * ray.direction;
    to.col(count + k) = to.col(k) + extent * normal;
    from.col(k) = points.col(k), from.col(count + k) = points.col(k) + extent * outward;
    pixels_per_length += first.project(to.col(k)).jacobian.norm() / std::sqrt(2.0) / count;
  }
  found.pose = Eigen::Isometry3d(Eigen::umeyama(from, to, false));
  const SurfacePoints off = (found.pose * points) - to.leftCols(count);
  found.misfit = off.colwise().norm().maxCoeff();
  if (!(found.misfit <= k_max_misfit * extent))
    throw DataError(fmt::format(
        "registration of the cameras: a point is {:.3g} mm from where the cameras see it: check pixels, points "
        "(their order) and the unit of the calibration",
        1e3 * found.misfit));
  // 2n numbers less the three fitted.
  const double fitted_std = count > 2 ? off.norm() / std::sqrt(2.0 * count - 3) : 0;
  found.turn_std = std::max(point_std / pixels_per_length, fitted_std) / extent;
  return found;
}

void use_pose(const StereoPose& pose, StereoOptions& options) {
  const Index size = k_camera_parameters, count = std::ssize(options.cameras);
  CalibrationError& error = options.calibration;
  error.names.emplace_back("registration.turn");
  error.factor.conservativeResizeLike(Eigen::MatrixXd::Zero(size * count, error.factor.cols() + 1));
  for (Index c = 0; c < count; ++c) {
    Camera& camera = options.cameras[c];
    const Eigen::Vector3d moved = camera.rotation * pose.pose.translation();
    camera.translation += moved;
    camera.rotation *= pose.pose.linear();
    auto factor = error.factor.middleRows(size * c, size);
    // A turn of the camera was one about the world's origin, and is one about the model's.
    for (Index k = 0; k + 1 < factor.cols(); ++k)
      factor.col(k).tail<3>() += factor.col(k).segment<3>(13).cross(moved);
    // A turn of the body about the middle of the points, as a change of the camera.
    auto turn = factor.col(factor.cols() - 1);
    turn.segment<3>(13) = pose.turn_std * camera.rotation * pose.outward;
    turn.tail<3>() = -pose.turn_std * camera.rotation * pose.outward.cross(pose.middle);
  }
}

}  // namespace knothe::imaging
