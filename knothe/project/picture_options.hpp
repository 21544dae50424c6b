#pragma once
/// @file The tables of a project file that say where pictures are and how displacements come from them:
/// [data] pictures, [dic].
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/picture_series.hpp"

namespace knothe::project {

struct Values;
struct Project;

/// [dic] registration = "outline".
struct OutlineRegistration {
  std::vector<std::array<double, 2>> corners;  ///< of the body's face, m (right, up); empty: the model's
  std::string picture;                         ///< resolved; empty: the first reference
  double scale_std = 0;                        ///< relative; 0: the scale given is only where to begin
};

/// What a project says of its pictures; nothing is looked up on disk yet.
struct PictureOptions {
  std::string folder;                   ///< [data] pictures, resolved; empty: the pictures are listed
  std::vector<std::string> references;  ///< names in the folder, or resolved paths if there is none
  std::vector<std::string> pictures;    ///< resolved paths, where there is no folder
  std::vector<double> times;
  imaging::SeriesOptions series;  ///< all but the pictures themselves
  /// Where a scale or a registration is given, without the lens; with `outline` where its fit begins
  /// (picture_registration.hpp).
  std::optional<imaging::PictureFrame> frame;
  std::optional<OutlineRegistration> outline;
  imaging::View view = imaging::View::side;
  std::optional<double> plane;  ///< m; otherwise the model's outermost face
  bool model_mesh = false;      ///< correlate on the model's surface mesh
  std::string mesh_file;        ///< resolved; empty: none
  bool mesh_in_metres = false;  ///< unit of that file
  std::string lens;             ///< [dic] lens, resolved; empty: the lens does not distort
  std::string cameras;          ///< [dic] cameras, resolved; empty: one camera, without calibration
  double camera_unit = 1e-3;    ///< m
  std::string calibration_std;  ///< resolved; empty: the calibration is exact
  std::vector<std::string> other_folders;  ///< [dic] other_pictures, resolved: one for each further camera
  /// Points found in the (first) reference, px, and where they are on the model's face, m (right, up).
  std::vector<std::array<double, 2>> pixels, points;
  double point_std = 0.5;  ///< px
};

/// Reads [dic] and [data] pictures, times. Complaints go to `values`.
[[nodiscard]] PictureOptions read_pictures(Values& values);

/// The series with its pictures looked up. Errors: ProjectError where the project names none, DataError for
/// the folder.
[[nodiscard]] imaging::SeriesOptions series_options(const Project& project);
/// The same of every camera of [dic] cameras, in the order of the calibration. The same errors.
[[nodiscard]] std::vector<imaging::SeriesOptions> camera_series_options(const Project& project);
/// Without pictures: they will come in the folder that the service watches, or from its camera. The same
/// errors.
[[nodiscard]] imaging::SeriesOptions live_series_options(const Project& project);

}  // namespace knothe::project
