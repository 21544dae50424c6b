#pragma once
/// @file What an error of the calibration does to the motion of a surface: one error, shared by all nodes and
/// all sets of pictures, of as many unknowns as the cameras have parameters.
#include <Eigen/Core>
#include <vector>

#include "knothe/imaging/stereo/stereo_surface.hpp"

namespace knothe::imaging {

/// S = ∂u/∂c, 3n × 19 C (CameraChange of the first camera, then the next), by the implicit function at the
/// motion that surface_motion found: with N = Σ_c J_cᵀ Π_c J_c
///   N ∂u/∂c = −Σ_c J_cᵀ(X + u) Π_c [∂_c P_c(X + u) − ∂_c P_c(X) + (J_c(X + u) − J_c(X)) ∂X/∂c],
/// ∂X/∂c the same of the shape. Rows of nodes that are not measured are 0. If the calibration has the
/// covariance C, the displacements have S C Sᵀ beside the inverse of their precision. Errors: those of
/// surface_motion.
[[nodiscard]] Eigen::MatrixXd calibration_sensitivity(const std::vector<Camera>& cameras,
                                                      const SurfacePoints& points,
                                                      const std::vector<CameraMotion>& motions,
                                                      const SurfaceMotion& found);

}  // namespace knothe::imaging
