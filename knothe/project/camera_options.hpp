#pragma once
/// @file The table [serve.camera] of a project file: a GigE or USB3 camera that the service reads itself.
#include <optional>
#include <string>
#include <vector>

#include "knothe/base/enum_names.hpp"

namespace knothe::project {

/// What makes the camera take a frame.
enum class CameraTrigger {
  free,      ///< its own clock
  software,  ///< the service, at the frame rate
  hardware   ///< a line of the camera
};
constexpr auto names_of(CameraTrigger) {
  return std::to_array<Named<CameraTrigger>>({{CameraTrigger::free, "free"},
                                              {CameraTrigger::software, "software"},
                                              {CameraTrigger::hardware, "hardware"}});
}

/// In which format frames are kept.
enum class FrameFormat { tiff, png };
constexpr auto names_of(FrameFormat) {
  return std::to_array<Named<FrameFormat>>({{FrameFormat::tiff, "tiff"}, {FrameFormat::png, "png"}});
}

struct CameraOptions {
  bool wanted = false;               ///< the table is there
  std::string address, serial;       ///< at most one of them; none: the first camera that is found
  std::optional<double> exposure;    ///< s
  std::optional<double> gain;        ///< in the camera's unit, mostly dB
  std::vector<std::size_t> region;   ///< x, y, width, height, pixels of the sensor; empty: as it is
  std::string pixel_format;          ///< as the camera calls it; empty: as it is
  std::optional<int> packet_size;    ///< bytes, GigE alone
  std::optional<double> frame_rate;  ///< Hz
  CameraTrigger trigger = CameraTrigger::free;
  std::string trigger_line = "Line1";  ///< of a hardware trigger
  std::string keep;                    ///< folder, resolved; empty: frames are not kept
  FrameFormat keep_format = FrameFormat::tiff;
};

}  // namespace knothe::project
