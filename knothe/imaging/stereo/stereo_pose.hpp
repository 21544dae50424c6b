#pragma once
/// @file Where the plane face of a model is in the frame of a calibration.
#include <Eigen/Geometry>
#include <vector>

#include "knothe/imaging/stereo/stereo_series.hpp"

namespace knothe::imaging {

struct StereoPose {
  Eigen::Isometry3d pose;        ///< model to world
  Eigen::Vector3d outward;       ///< normal of the face towards the cameras, in the model
  Eigen::Vector3d middle;        ///< of the points, in the model
  double turn_std = 0;           ///< rad, about that normal
  double flatness = 0;           ///< root mean square distance of the surface from its plane, unit of length
  double misfit = 0;             ///< largest distance of a point from where it was found
};

/// The plane that fits the measured surface best, and in it the rigid motion that brings points of the model
/// (3 × k, k ≥ 2, on a plane with the normal `outward`) to where the first camera sees them (2 × k, px, found
/// to `point_std`): lines of sight meet the plane, so that points may lie beside the measured part. The turn's
/// standard deviation is that of fit_picture_frame. Errors: UsageError for too few points or all in one place;
/// DataError where their distances differ by more than 2 % of their extent from those seen: a wrong unit.
[[nodiscard]] StereoPose fit_stereo_pose(const Camera& first, const SurfacePoints& surface,
                                         const Eigen::Matrix2Xd& pixels, const SurfacePoints& points,
                                         const Eigen::Vector3d& outward, double point_std);

/// Makes the model's frame that of the cameras, with the error of the turn among those of the calibration.
void use_pose(const StereoPose& pose, StereoOptions& options);

}  // namespace knothe::imaging
