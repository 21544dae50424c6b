#include <malloc.h>

#include <optional>

#include "apps/knothe/command_line.hpp"
#include "apps/knothe/dic_cameras.hpp"
#include "apps/number_checks.hpp"
#include "knothe/base/error.hpp"
#include "knothe/imaging/mesh/mesh_file.hpp"
#include "knothe/imaging/series/pattern_report.hpp"
#include "knothe/report/pages/picture_output.hpp"

namespace knothe::commands {
namespace {

struct DicArguments {
  std::vector<std::string> inputs;                ///< a project file, or reference and deformed pictures
  std::optional<double> element_size, prefilter;  ///< px; override the project's
  std::optional<double> saturation;               ///< grey level
  std::vector<double> region;                     ///< x0, y0, x1, y1, px
  bool pattern = false;                           ///< only assess the reference picture, before a test
  bool crack = false;                             ///< look for a crack in every picture
  std::string mask, mesh;                         ///< files
  CameraArguments cameras;                        ///< two or more
  report::PictureFiles files;                     ///< to write
  bool grey = false;                              ///< use the luminance of colour pictures
  bool json = false;
};

imaging::Region parse_region(const std::vector<double>& corners) {
  if (corners.size() != 4 || corners[0] == corners[2] || corners[1] == corners[3])
    throw UsageError("--roi takes two opposite corners of the mesh, px: --roi X0,Y0,X1,Y1");
  return {corners[0], corners[1], corners[2], corners[3]};
}

report::PictureTask task_of(const DicArguments& a) {
  report::PictureTask task;
  imaging::SeriesOptions& series = task.series;
  if (a.inputs.size() == 1 && a.inputs.front().ends_with(".toml")) {
    task = report::picture_task(project::read_project(a.inputs.front()));
  } else {
    if (a.inputs.size() < 2 && !(a.pattern && !a.inputs.empty()))
      throw UsageError(
          "dic takes a project file (.toml), or a reference picture and at least one deformed one; --pattern "
          "takes the reference alone");
    // Several pictures to be assessed are several of the unloaded surface: their differences tell the noise.
    series.find_prefilter = true;
    series.references.assign(a.inputs.begin(), a.pattern ? a.inputs.end() : a.inputs.begin() + 1);
    if (!a.pattern) series.pictures.assign(a.inputs.begin() + 1, a.inputs.end());
  }
  if (a.element_size) series.element_size = *a.element_size;
  if (!a.mesh.empty()) series.mesh = imaging::read_image_mesh(a.mesh, std::nullopt);
  if (!a.region.empty()) series.region = parse_region(a.region);
  if (!a.mask.empty()) series.mask = a.mask;
  if (a.crack && !series.crack) series.crack = imaging::CrackSearchOptions{};
  if (a.pattern) series.pictures.clear(), series.times.clear();
  if (a.prefilter) series.correlation.prefilter_sigma = *a.prefilter, series.find_prefilter = false;
  if (a.saturation) series.correlation.saturation = *a.saturation;
  if (a.grey) series.colour = files::Colour::grey;
  set_cameras(a.cameras, a.pattern || a.crack, task);
  return task;
}

int dic(const DicArguments& arguments) {
  if (!arguments.files.table.empty()) imaging::require_table_name(arguments.files.table);
  const report::PictureTask task = task_of(arguments);
  // Pictures are read by a thread: a heap of its own would keep the memory of the largest.
  mallopt(M_ARENA_MAX, 1);
  const files::CommandOutput output(arguments.json);
  if (!arguments.pattern) return report::measure_pictures(task, arguments.files, output);
  report::assess_pattern(task, arguments.files, output);
  return 0;
}

}  // namespace

void add_dic(CLI::App& app, Command& chosen) {
  static DicArguments arguments;
  report::PictureFiles& files = arguments.files;
  CLI::App& command =
      add(app, chosen, arguments, dic, "dic", "Image correlation: displacements from pictures.",
          "knothe dic reference.tif a.tif b.tif --roi 100,60,1100,900 --element-size 25 -o u.h5");
  command.add_option("FILES", arguments.inputs, "project file, or REFERENCE DEFORMED…")->required();
  command.add_option("--element-size", arguments.element_size, "size of the elements, px (default: 25)")
      ->check(positive_number());
  command.add_option("--roi", arguments.region, "X0,Y0,X1,Y1: two opposite corners of the mesh, px")
      ->delimiter(',');
  command.add_option("--mask", arguments.mask, "picture that is 0 where the surface is not to be measured");
  command.add_option("--mesh", arguments.mesh,
                     "mesh to correlate on instead of equal elements: Gmsh (.msh) or VTK (.vtu), in px");
  add_camera_options(command, arguments.cameras);
  command
      .add_option("--prefilter", arguments.prefilter,
                  "Gaussian on all pictures, px; default: 1 where the speckle is aliased")
      ->check(number_from_zero());
  command
      .add_option("--saturation", arguments.saturation,
                  "grey level from which a pixel is left out; default: the highest of the pictures")
      ->check(positive_number());
  command.add_option("--at", files.at,
                     "CSV file (header x,y): points of the reference picture at which to output "
                     "displacements");
  command.add_flag("--std", files.std, "with --at: columns u_std and v_std, standard deviations in px");
  command.add_flag("--grey", arguments.grey, "use the luminance of colour pictures");
  command.add_option("-o,--output", files.output,
                     ".h5, .vtu or .pvd; with --at a CSV file, or a folder for several pictures");
  command.add_option("--maps", files.maps, "folder for maps over the picture (.png)");
  command.add_flag("--pattern", arguments.pattern,
                   "before a test: is the speckle of the reference picture good enough, and how accurate "
                   "will the measurement be?");
  command.add_option(
      "--table", files.table,
      "file (.txt, .json, .html) for the settings and noise floor to include in a test report");
  command.add_flag("--resume", files.resume,
                   "continue with the pictures that are not in the output file (.h5) yet");
  command.add_flag("--crack", arguments.crack, "path, opening and tip of a crack in every picture");
  command.add_flag("--json", arguments.json, "one line of JSON per picture on stdout");
}

}  // namespace knothe::commands
