#pragma once
/// @file `knothe dic` with two or more cameras.
#include <optional>
#include <string>
#include <vector>

#include "knothe/imaging/stereo/stereo_series.hpp"
#include "knothe/report/pages/picture_output.hpp"

namespace knothe::report {

/// The cameras of a calibration in metres; `unit` of the files, m. `error`: of the calibration, empty: none.
/// Errors: DataError.
[[nodiscard]] imaging::StereoOptions cameras_in_metres(const std::string& path, double unit,
                                                       const std::string& error);

/// Each camera's series: `first`, and pictures of the others in a list, camera by camera, each beginning with
/// its reference. Errors: UsageError where the list cannot be divided so.
[[nodiscard]] std::vector<imaging::SeriesOptions> listed_series(const imaging::SeriesOptions& first,
                                                                const std::vector<std::string>& others);

/// Measures all sets of pictures and prints a line for each; the exit status is that of measure_pictures.
/// Errors: UsageError for files and settings that are for one camera only, Interrupted, IoError.
[[nodiscard]] int measure_cameras(const imaging::StereoOptions& task, const std::string& project_text,
                                  const PictureFiles& files, const files::CommandOutput& output);

}  // namespace knothe::report
