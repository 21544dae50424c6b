#pragma once
/// @file Maps of measured displacements over the picture they come from, with colour bars (PNG).
#include <optional>
#include <string>

#include "knothe/imaging/picture_series.hpp"
#include "knothe/imaging/registration.hpp"

namespace knothe::report {

/// Writes PATH.png: four maps over the reference picture: displacement to the right, displacement down (px,
/// or with a frame the model's components in µm), residual (grey levels), and largest principal strain.
/// Elements taken out show the bare picture inside a red line. Errors: IoError.
void write_displacement_maps(const std::string& path, const imaging::PictureSeries& series,
                             const imaging::PictureResult& result,
                             const std::optional<imaging::PictureFrame>& frame);

}  // namespace knothe::report
