#include "knothe/imaging/camera/camera.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"

namespace knothe::imaging {
namespace {

struct Distorted {
  Eigen::Vector2d place;
  Eigen::Matrix2d gradient;                ///< by the undistorted place
  Eigen::Matrix<double, 2, 8> parameters;  ///< by k1 … k6, p1, p2
};

/// (x_d, y_d) of (x, y): see Camera.
Distorted distorted(const Camera& camera, const Eigen::Vector2d& at) {
  const auto& k = camera.radial;
  const auto [p1, p2] = camera.tangential;
  const double x = at.x(), y = at.y(), s = x * x + y * y;
  const double above = 1 + s * (k[0] + s * (k[1] + s * k[2])), below = 1 + s * (k[3] + s * (k[4] + s * k[5]));
  const double slope_above = k[0] + s * (2 * k[1] + s * 3 * k[2]),
               slope_below = k[3] + s * (2 * k[4] + s * 3 * k[5]);
  const double g = above / below, slope = (slope_above - g * slope_below) / below;  // dg/d(r²)
  Distorted d;
  d.place << x * g + 2 * p1 * x * y + p2 * (s + 2 * x * x), y * g + p1 * (s + 2 * y * y) + 2 * p2 * x * y;
  const double mixed = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y;
  d.gradient << g + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, mixed, mixed,
      g + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x;
  for (int power = 1; power <= 3; ++power) {
    const double by_above = std::pow(s, power) / below;
    d.parameters.col(power - 1) = by_above * at, d.parameters.col(power + 2) = -g * by_above * at;
  }
  d.parameters.col(6) << 2 * x * y, s + 2 * y * y;
  d.parameters.col(7) << s + 2 * x * x, 2 * x * y;
  return d;
}

/// R X + t.
Eigen::Vector3d in_front(const Camera& camera, const Eigen::Vector3d& point) {
  const Eigen::Vector3d at = camera.rotation * point + camera.translation;
  if (!(at.z() > 0))
    throw NumericalError(fmt::format(
        "the point ({}, {}, {}) is not in front of the camera: is the calibration that of these cameras?",
        point.x(), point.y(), point.z()));
  return at;
}

}  // namespace

Projection Camera::project(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d at = in_front(*this, point);
  const Distorted d = distorted(*this, at.head<2>() / at.z());
  Eigen::Matrix2d sensor;
  sensor << fx, skew, 0, fy;
  Eigen::Matrix<double, 2, 3> central;
  central << 1 / at.z(), 0, -at.x() / (at.z() * at.z()), 0, 1 / at.z(), -at.y() / (at.z() * at.z());
  return {sensor * d.place + Eigen::Vector2d(cx, cy), sensor * d.gradient * central * rotation};
}

Eigen::Matrix<double, 2, k_camera_parameters> Camera::parameter_jacobian(const Eigen::Vector3d& point) const {
  const Distorted d = distorted(*this, in_front(*this, point).hnormalized());
  Eigen::Matrix2d sensor;
  sensor << fx, skew, 0, fy;
  const Eigen::Matrix<double, 2, 3> by_place = project(point).jacobian * rotation.transpose();  // in its axes
  const Eigen::Vector3d turned = rotation * point;
  Eigen::Matrix<double, 2, k_camera_parameters> jacobian;
  jacobian.col(0) << d.place.x(), 0;
  jacobian.col(1) << 0, d.place.y();
  jacobian.col(2) << 1, 0;
  jacobian.col(3) << 0, 1;
  jacobian.col(4) << d.place.y(), 0;
  jacobian.middleCols<8>(5) = sensor * d.parameters;
  for (int axis = 0; axis < 3; ++axis)
    jacobian.col(13 + axis) = by_place * Eigen::Vector3d::Unit(axis).cross(turned);
  jacobian.rightCols<3>() = by_place;
  return jacobian;
}

Camera Camera::changed(const CameraChange& change) const {
  Camera camera = *this;
  camera.fx += change[0], camera.fy += change[1], camera.cx += change[2], camera.cy += change[3];
  camera.skew += change[4];
  for (int k = 0; k < 6; ++k) camera.radial[k] += change[5 + k];
  for (int k = 0; k < 2; ++k) camera.tangential[k] += change[11 + k];
  const Eigen::Vector3d turn = change.segment<3>(13);
  if (turn.norm() > 0)
    camera.rotation = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix() * rotation;
  camera.translation += change.tail<3>();
  return camera;
}

Ray Camera::ray(const Eigen::Vector2d& pixel) const {
  const double y_d = (pixel.y() - cy) / fy;
  const Eigen::Vector2d wanted((pixel.x() - cx - skew * y_d) / fx, y_d);
  Eigen::Vector2d at = wanted;
  for (int k = 0; k < 50; ++k) {
    const Distorted d = distorted(*this, at);
    const Eigen::Vector2d step = d.gradient.inverse() * (wanted - d.place);
    at += step;
    if (!at.allFinite()) break;
    if (step.norm() < 1e-14 * (1 + at.norm())) {
      const Eigen::Vector3d direction(at.x(), at.y(), 1);
      return {-(rotation.transpose() * translation), rotation.transpose() * direction};
    }
  }
  throw NumericalError(
      fmt::format("the lens distortion has no line of sight for the pixel ({}, {}): check the calibration's "
                  "coefficients, or measure nearer to the middle of the picture",
                  pixel.x(), pixel.y()));
}

Eigen::Matrix3d rotation_of_angles(double alpha, double beta, double gamma) {
  constexpr double k_degree = std::numbers::pi / 180;
  using Turn = Eigen::AngleAxisd;
  return (Turn(gamma * k_degree, Eigen::Vector3d::UnitZ()) * Turn(beta * k_degree, Eigen::Vector3d::UnitY()) *
          Turn(alpha * k_degree, Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

}  // namespace knothe::imaging
