#pragma once
/// @file `knothe dic` with two or more cameras.
#include <optional>
#include <string>
#include <vector>

#include "knothe/imaging/stereo/stereo_series.hpp"
#include "knothe/report/pages/picture_output.hpp"

namespace knothe::report {

/// Each camera's series: `first`, and pictures of the others in a list, camera by camera, each beginning with
/// its reference. Errors: UsageError where the list cannot be divided so.
[[nodiscard]] std::vector<imaging::SeriesOptions> listed_series(const imaging::SeriesOptions& first,
                                                                const std::vector<std::string>& others);

/// Measures all sets of pictures and prints a line for each, without `output` to stderr; the exit status is
/// that of measure_pictures.
/// Errors: UsageError for files and settings that are for one camera only, Interrupted, IoError.
[[nodiscard]] int measure_cameras(const imaging::StereoOptions& task, const std::string& project_text,
                                  const PictureFiles& files, const files::CommandOutput* output);

/// Measures the pictures of the cameras of a project into RESULTS/displacements.h5, which then is its data
/// file in place of them; pictures without times have the model's. Errors: as above; DataError where no set
/// could be measured.
void measure_first(project::Project& project);

}  // namespace knothe::report
