#pragma once
/// @file What the commands say of a picture that was measured, and of one whose speckle is to be used.
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "knothe/imaging/crack/crack_measurement.hpp"
#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/pattern_report.hpp"
#include "knothe/imaging/series/picture_series.hpp"
#include "knothe/imaging/stereo/stereo_series.hpp"

namespace knothe::record {

/// For `--json`: px, and with a frame the model's place (m) of the tip and lengths in m beside them.
[[nodiscard]] nlohmann::ordered_json crack_record(const imaging::CrackMeasurement& crack,
                                                  const std::optional<imaging::PictureFrame>& frame);

/// A picture for `--json`, and in words (a crack on a line of its own); `noise_std`: of a displacement, px,
/// mean over the nodes.
[[nodiscard]] nlohmann::ordered_json picture_record(const imaging::PictureSeries& series,
                                                    const imaging::PictureResult& result, double noise_std,
                                                    const std::optional<imaging::PictureFrame>& frame);
[[nodiscard]] std::string picture_text(const imaging::PictureResult& result, double noise_std,
                                       const std::optional<imaging::PictureFrame>& frame);

/// The same of a set of pictures of several cameras: named by that of the first.
[[nodiscard]] nlohmann::ordered_json stereo_record(const imaging::StereoSeries& series,
                                                   const imaging::StereoResult& result);
[[nodiscard]] std::string stereo_text(const imaging::StereoResult& result);

/// The same of the speckle pattern of `name`.
[[nodiscard]] nlohmann::ordered_json pattern_record(const std::string& name,
                                                    const imaging::PatternReport& pattern,
                                                    const std::optional<imaging::PictureFrame>& frame);
[[nodiscard]] std::string pattern_text(const imaging::PatternReport& pattern,
                                       const std::optional<imaging::PictureFrame>& frame);

}  // namespace knothe::record
