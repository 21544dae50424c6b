#pragma once
/// @file Maps of measured displacements over the picture they come from, with colour bars (PNG).
#include <optional>
#include <string>

#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/picture_series.hpp"
#include "knothe/imaging/stereo/stereo_series.hpp"

namespace knothe::report {

/// Writes PATH.png: four maps over the reference picture: displacement to the right, displacement down (px,
/// or with a frame the model's components in µm), residual (grey levels), and largest principal strain.
/// `noise_std`: of a displacement, px, mean over the nodes. Axes are px, or mm in the model for a camera that
/// is not turned; a line above tells how well the picture was measured, lines below what colours and lines
/// mean. Elements taken out show the bare picture inside a red line; a crack is a yellow line with a ring at
/// its tip and bars at the ends of the tip's 95 % interval. Errors: IoError.
void write_displacement_maps(const std::string& path, const imaging::PictureSeries& series,
                             const imaging::PictureResult& result, double noise_std,
                             const std::optional<imaging::PictureFrame>& frame);

/// The same of several cameras, over the reference picture of the first: displacement along x, y and z (µm),
/// and largest principal strain in the surface.
void write_surface_maps(const std::string& path, const imaging::StereoSeries& series,
                        const imaging::StereoResult& result);

/// Writes PATH.png: the standard deviations (px, with a frame µm) of displacements to the right and down over
/// the reference picture, as predicted for its pattern. `std`: one per displacement, 0 where nothing can be
/// measured. Errors: IoError.
void write_deviation_maps(const std::string& path, const imaging::PictureSeries& series,
                          const Eigen::VectorXd& std, const std::optional<imaging::PictureFrame>& frame);

}  // namespace knothe::report
