#pragma once
/// @file One page of all maps of a series of pictures, with a table of what was measured.
#include <optional>
#include <string>
#include <vector>

#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/picture_series.hpp"

namespace knothe::report {

/// A picture and its maps.
struct MappedPicture {
  const imaging::PictureResult* result = nullptr;
  double noise_std = 0;  ///< px, mean over the nodes
  std::string stem;      ///< its maps are STEM.png; empty: there are none
};

/// Writes FOLDER/index.html: maps with values under the cursor, a line on them and its elongation, a line of
/// a table for each picture (how well it was measured, its crack), and below the maps that are files beside
/// it. `registration`: what is to be said of the outline, whose map is
/// registration.png; empty: nothing. Errors: IoError.
void write_maps_page(const std::string& folder, const imaging::PictureSeries& series,
                     const std::vector<MappedPicture>& pictures,
                     const std::optional<imaging::PictureFrame>& frame, const std::string& registration);

}  // namespace knothe::report
