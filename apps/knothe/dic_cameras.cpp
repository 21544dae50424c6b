#include "apps/knothe/dic_cameras.hpp"

#include "knothe/base/error.hpp"
#include "knothe/report/pages/stereo_output.hpp"

namespace knothe::commands {

void add_camera_options(CLI::App& command, CameraArguments& arguments) {
  command.add_option("--cameras", arguments.calibration,
                     "calibration of two or more cameras, OpenCV's (.yaml, .xml), DICe's (.xml) or MatchID's "
                     "(.caldat): three components, in m; FILES are the pictures of its first camera");
  command.add_option("--camera-unit", arguments.unit, "unit of length of the calibration (default: mm)")
      ->check(CLI::IsMember({"mm", "m"}));
  command.add_option("--calibration-std", arguments.std,
                     "uncertainty of the calibration: CSV parameter,std with rows camera0.fx, …, or a "
                     "covariance");
  command.add_option(
      "--other", arguments.other,
      "with --cameras: reference and deformed pictures of the further cameras, in the same order");
}

void set_cameras(const CameraArguments& arguments, bool single, report::PictureTask& task) {
  if (arguments.calibration.empty() != arguments.other.empty())
    throw UsageError("--cameras CALIBRATION and --other PICTURES… belong together");
  if (arguments.calibration.empty() && !(arguments.unit.empty() && arguments.std.empty()))
    throw UsageError(
        "--camera-unit and --calibration-std are those of a calibration: give --cameras, or [dic] camera_unit "
        "and calibration_std");
  if (!arguments.calibration.empty()) {
    task.cameras =
        imaging::cameras_in_metres(arguments.calibration, arguments.unit == "m" ? 1 : 1e-3, arguments.std);
    task.cameras->series = report::listed_series(task.series, arguments.other);
  }
  if (!task.cameras) return;
  if (single) throw UsageError("--pattern and --crack are for one camera: leave out --cameras, or them");
  task.cameras->series.front() = task.series;
  for (imaging::SeriesOptions& other : task.cameras->series) {
    other.colour = task.series.colour, other.correlation = task.series.correlation;
    other.find_prefilter = task.series.find_prefilter;
  }
}

}  // namespace knothe::commands
