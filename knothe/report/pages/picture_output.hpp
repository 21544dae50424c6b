#pragma once
/// @file `knothe dic`: pictures are correlated one by one, and what was asked for is written.
#include <chrono>
#include <optional>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/files/command_output.hpp"
#include "knothe/imaging/mesh/outline_registration.hpp"
#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/picture_series.hpp"
#include "knothe/imaging/stereo/stereo_series.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::report {

/// What is measured.
struct PictureTask {
  imaging::SeriesOptions series;
  std::optional<imaging::PictureFrame> frame;
  std::optional<imaging::OutlineFit> registration;  ///< where the outline of the body tells the frame
  std::optional<imaging::StereoOptions> cameras;    ///< several, in place of `series`
  std::string project_text;
};

/// The task of a project, with the model's mesh where it needs one.
[[nodiscard]] PictureTask picture_task(project::Project project);

/// Files to write; empty: none.
struct PictureFiles {
  std::string at;       ///< CSV x,y: points to give displacements at; needs `output`
  std::string output;   ///< .h5, .vtu, .pvd; with `at` .csv or a folder
  std::string maps;     ///< folder for PNG maps
  std::string table;    ///< for the settings that a report should hold
  bool std = false;     ///< with `at`: standard deviations as well
  bool resume = false;  ///< go on with what `output` (.h5) holds
};

/// Measures all pictures and prints a line for each. Every 30 s the HDF5 file is written. Returns the exit
/// status: 0 if any picture was measured, else why not: unreadable or unsuitable (4), or not converged (6).
/// Errors: UsageError for files that do not go together, Interrupted with what is kept, IoError.
[[nodiscard]] int measure_pictures(const PictureTask& task, const PictureFiles& files,
                                   const files::CommandOutput& output);

/// A file name for the results of each picture: its own, without folder and ending; made different where two
/// are alike.
[[nodiscard]] std::vector<std::string> stems_of(const std::vector<std::string>& pictures);

/// A long series must not be lost with the machine's power: its file is written so often.
inline constexpr std::chrono::seconds k_save_every{30};

/// The exit status where any picture was measured, or at least read.
[[nodiscard]] constexpr int exit_status(bool measured, bool read) {
  return static_cast<int>(measured ? ExitStatus::done : read ? ExitStatus::numerical : ExitStatus::data);
}

/// What is to be expected of a test with this surface and camera: looks at the references alone.
void assess_pattern(const PictureTask& task, const PictureFiles& files, const files::CommandOutput& output);

}  // namespace knothe::report
