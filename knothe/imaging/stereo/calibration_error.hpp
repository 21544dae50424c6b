#pragma once
/// @file What an error of the calibration does to the motion of a surface: one error, shared by all nodes and
/// all sets of pictures, of as many unknowns as the cameras have parameters.
#include <Eigen/Core>
#include <string>
#include <vector>

#include "knothe/imaging/stereo/stereo_surface.hpp"

namespace knothe::imaging {

/// What the parameters of C cameras are uncertain by, N(0, F Fᵀ).
struct CalibrationError {
  std::vector<std::string> names;  ///< of the columns
  Eigen::MatrixXd factor;          ///< F, 19 C × q (CameraChange of the first camera, then the next)
};

/// From CSV with a row for each parameter that is uncertain, named in the column `parameter`: camera0.fx, fy,
/// cx, cy, skew, k1 … k6, p1, p2, wx, wy, wz (a turn about the camera's axes, rad), tx, ty, tz; camera1.fx ….
/// A column `std`, or one for each of the rows, in their order: the covariance; a column of F is a parameter,
/// or a principal axis. `unit`: of length in the file, in the cameras' own. Errors: DataError, IoError.
[[nodiscard]] CalibrationError read_calibration_error(const std::string& path, Index cameras, double unit);

/// S = ∂u/∂c, 3n × 19 C (CameraChange of the first camera, then the next), by the implicit function at the
/// motion that surface_motion found: with N = Σ_c J_cᵀ Π_c J_c
///   N ∂u/∂c = −Σ_c J_cᵀ(X + u) Π_c [∂_c P_c(X + u) − ∂_c P_c(X) + (J_c(X + u) − J_c(X)) ∂X/∂c],
/// ∂X/∂c the same of the shape. Rows of nodes that are not measured are 0. If the calibration has the
/// covariance C, the displacements have S C Sᵀ beside the inverse of their precision. Errors: those of
/// surface_motion.
[[nodiscard]] Eigen::MatrixXd calibration_sensitivity(const std::vector<Camera>& cameras,
                                                      const StereoSurface& surface,
                                                      const std::vector<CameraMotion>& motions,
                                                      const SurfaceMotion& found);

}  // namespace knothe::imaging
