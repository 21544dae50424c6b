#pragma once
/// @file Calibrations of other programs as cameras.
#include <string>
#include <vector>

#include "knothe/imaging/camera/camera.hpp"

namespace knothe::imaging {

/// The cameras in a calibration file, two or more, in its order and unit of length. The format is told from
/// the content:
/// - OpenCV's FileStorage (.yaml, .xml) with M1, D1, M2, D2, R, T as its stereo calibration writes them (or
///   cameraMatrix1, distCoeffs1 …): the world is the first camera, X_2 = R X_1 + T;
/// - MatchID's table (.caldat) of Cam0_Fx …, Cam1_…, X_1 = R X_0 + T, R of Theta, Phi, Psi
/// (rotation_of_angles);
/// - DICe's camera system (.xml): R by rows or angles, t, world to camera; OpenCV's distortion.
/// Errors: IoError; DataError naming file, key and remedy: what cannot be read, lacks a key, or has
/// coefficients that Camera does not have (thin prism, tilted sensor) or whose meaning is not known with
/// certainty (VIC-3D's and DICe's other models of distortion).
[[nodiscard]] std::vector<Camera> read_cameras(const std::string& path);
/// The same of a file's text.
[[nodiscard]] std::vector<Camera> parse_cameras(const std::string& text, const std::string& path);

/// The lens of the only camera, or of the first, in a calibration file: OpenCV's with camera_matrix and
/// distortion_coefficients too (or cameraMatrix, distCoeffs). Its pose is left out. The same errors.
[[nodiscard]] Camera read_lens(const std::string& path);

}  // namespace knothe::imaging
