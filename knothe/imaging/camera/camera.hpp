#pragma once
/// @file A camera with lens distortion: where a point of the world is in its picture, and what line of sight
/// a place in the picture has.
#include <Eigen/Core>
#include <array>

namespace knothe::imaging {

/// Where a point is in a picture.
struct Projection {
  Eigen::Vector2d pixel;                 ///< px, x right, y down
  Eigen::Matrix<double, 2, 3> jacobian;  ///< ∂pixel/∂X, px per unit of length
};

/// The points origin + z direction; z is the depth along the camera's axis.
struct Ray {
  Eigen::Vector3d origin, direction;
};

inline constexpr int k_camera_parameters = 19;
/// Small changes of a camera's parameters: fx, fy, cx, cy, skew, k1 … k6, p1, p2, a turn ω (rad, about the
/// axes of the camera: R becomes exp(ω×) R), t.
using CameraChange = Eigen::Matrix<double, k_camera_parameters, 1>;

/// Pinhole, radial and tangential distortion as OpenCV has them. With (x, y) = (X_c, Y_c)/Z_c, X_c = R X + t,
/// r² = x² + y² and g = (1 + k1 r² + k2 r⁴ + k3 r⁶)/(1 + k4 r² + k5 r⁴ + k6 r⁶):
///   x_d = x g + 2 p1 x y + p2 (r² + 2x²),  y_d = y g + p1 (r² + 2y²) + 2 p2 x y,
///   pixel = (fx x_d + skew y_d + cx, fy y_d + cy).
struct Camera {
  double fx = 1, fy = 1;                                   ///< px
  double cx = 0, cy = 0;                                   ///< px, pixel centres at whole numbers
  double skew = 0;                                         ///< px
  std::array<double, 6> radial{};                          ///< k1 … k6
  std::array<double, 2> tangential{};                      ///< p1, p2
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< R, world to camera
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();   ///< t, unit of length of the world

  /// Errors: NumericalError for a point that is not in front of the camera.
  [[nodiscard]] Projection project(const Eigen::Vector3d& point) const;
  /// ∂pixel/∂change of project, px per unit of each parameter. The same errors.
  [[nodiscard]] Eigen::Matrix<double, 2, k_camera_parameters> parameter_jacobian(
      const Eigen::Vector3d& point) const;
  [[nodiscard]] Camera changed(const CameraChange& change) const;
  /// Errors: NumericalError for a pixel that the distortion makes of no direction.
  [[nodiscard]] Ray ray(const Eigen::Vector2d& pixel) const;
};

/// R = R_z(γ) R_y(β) R_x(α), angles in degrees, as DICe and VIC-3D write orientations (world to camera).
[[nodiscard]] Eigen::Matrix3d rotation_of_angles(double alpha, double beta, double gamma);

}  // namespace knothe::imaging
