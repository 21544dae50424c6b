#pragma once
/// @file `knothe dic` on the pictures of two cameras or more: its options.
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "knothe/report/pages/picture_output.hpp"

namespace knothe::commands {

struct CameraArguments {
  std::string calibration;         ///< file
  std::string unit;                ///< of length, in it; empty: mm
  std::string std;                 ///< file: its uncertainty; empty: exact
  std::vector<std::string> other;  ///< pictures of the further cameras
};

void add_camera_options(CLI::App& command, CameraArguments& arguments);

/// Several cameras, from the command line or the project; the other settings of the task go for each of them.
/// `single`: something that is for one camera is asked for too. Errors: UsageError, DataError.
void set_cameras(const CameraArguments& arguments, bool single, report::PictureTask& task);

}  // namespace knothe::commands
