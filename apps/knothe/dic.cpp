#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/knothe/commands.hpp"
#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/files/vtu.hpp"
#include "knothe/imaging/mesh/mesh_file.hpp"
#include "knothe/imaging/series/displacement_files.hpp"
#include "knothe/imaging/series/pattern_report.hpp"
#include "knothe/imaging/series/picture_series.hpp"
#include "knothe/project/picture_measurements.hpp"
#include "knothe/project/picture_registration.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/model/separated_model.hpp"
#include "knothe/report/figures/displacement_maps.hpp"
#include "knothe/report/figures/registration_map.hpp"
#include "knothe/report/pages/maps_page.hpp"
#include "knothe/report/results/picture_record.hpp"

namespace knothe::commands {
namespace {

namespace fs = std::filesystem;
using imaging::PictureResult;

constexpr std::chrono::seconds k_save_every{30};

/// All that the two forms of the command have in common once their arguments are read.
struct Task {
  imaging::SeriesOptions series;
  std::optional<imaging::PictureFrame> frame;
  std::optional<imaging::OutlineFit> registration;  ///< where the outline of the body tells the frame
  std::string project_text;
};

imaging::Region parse_region(const std::vector<double>& corners) {
  if (corners.size() != 4 || corners[0] == corners[2] || corners[1] == corners[3])
    throw UsageError("--roi takes two opposite corners of the mesh, px: --roi X0,Y0,X1,Y1");
  return {corners[0], corners[1], corners[2], corners[3]};
}

Task task_of(const DicArguments& a) {
  Task task;
  const bool project = a.files.size() == 1 && a.files.front().ends_with(".toml");
  if (project) {
    project::Project read = project::read_project(a.files.front());
    std::optional<reduction::Mesh> mesh;
    if (!read.model.empty() && (read.pictures.model_mesh || project::needs_model_outline(read)))
      mesh = reduction::SeparatedModel::load(read.model).contents().mesh;
    task.registration = project::register_pictures(read, mesh);
    task.series = project::series_options(read, mesh);
    if (read.pictures.frame) task.frame = project::picture_frame_of(read, mesh);
    task.project_text = read.text;
  } else {
    if (a.files.size() < 2 && !(a.pattern && !a.files.empty()))
      throw UsageError(
          "dic takes a project file (.toml), or a reference picture and at least one deformed one; --pattern "
          "takes "
          "the reference alone");
    // Several pictures to be judged are several of the unloaded surface: their differences tell the noise.
    task.series.references.assign(a.files.begin(), a.pattern ? a.files.end() : a.files.begin() + 1);
    if (!a.pattern) task.series.pictures.assign(a.files.begin() + 1, a.files.end());
  }
  if (a.element_size) task.series.element_size = *a.element_size;
  if (!a.mesh.empty()) task.series.mesh = imaging::read_image_mesh(a.mesh, std::nullopt);
  if (!a.region.empty()) task.series.region = parse_region(a.region);
  if (!a.mask.empty()) task.series.mask = a.mask;
  if (a.crack && !task.series.crack) task.series.crack = imaging::CrackOptions{};
  if (a.pattern) task.series.pictures.clear(), task.series.times.clear();
  if (a.prefilter) task.series.correlation.prefilter_sigma = *a.prefilter;
  return task;
}

/// A file name for a picture's results: its own, without folder and ending; made different where two are
/// alike.
std::vector<std::string> stems_of(const std::vector<std::string>& pictures) {
  std::vector<std::string> stems;
  for (const std::string& picture : pictures) {
    std::string stem = fs::path(picture).stem().string();
    if (std::find(stems.begin(), stems.end(), stem) != stems.end()) stem += fmt::format("_{}", stems.size());
    stems.push_back(stem);
  }
  return stems;
}

/// Writes what was asked for, picture by picture.
class Output {
 public:
  Output(const DicArguments& arguments, const Task& task)
      : arguments_(arguments), task_(task), stems_(stems_of(task.series.pictures)) {
    if (!arguments.at.empty()) {
      if (arguments.output.empty())
        throw UsageError("--at needs -o: a CSV file, or a folder for several pictures");
      files::refuse_overwriting(arguments.output, {arguments.at});
      const files::CsvTable table = files::CsvTable::read(arguments.at);
      const auto x = table.numbers("x"), y = table.numbers("y");
      points_.resize(static_cast<Eigen::Index>(x.size()), 2);
      for (std::size_t i = 0; i < x.size(); ++i) points_.row(static_cast<Eigen::Index>(i)) << x[i], y[i];
      if (several()) files::require_writable_folder(arguments.output);
    } else if (!arguments.output.empty() && !has_ending(".h5") && !has_ending(".vtu") &&
               !has_ending(".pvd")) {
      throw UsageError(
          fmt::format("-o {}: without --at it takes an HDF5 file (.h5), a field file (.vtu), or a "
                      "series of them (.pvd)",
                      arguments.output));
    } else if (has_ending(".vtu") && several()) {
      throw UsageError("-o: several pictures need a series, .pvd");
    }
    if (arguments.resume && !has_ending(".h5"))
      throw UsageError("--resume needs -o FILE.h5, what it goes on with");
    if (!arguments.maps.empty()) files::require_writable_folder(arguments.maps);
  }

  void add(const imaging::PictureSeries& series, const PictureResult& r, double noise_std) {
    noise_std_.push_back(noise_std);
    if (!arguments_.maps.empty() && r.correlation.iterations > 0)  // also to see why it did not converge
      report::write_displacement_maps((fs::path(arguments_.maps) / stems_[r.index]).string(), series, r,
                                      noise_std, task_.frame);
    if (arguments_.output.empty()) return;
    if (!arguments_.at.empty()) {
      const std::string path =
          several() ? (fs::path(arguments_.output) / (stems_[r.index] + ".csv")).string() : arguments_.output;
      if (!r.missing) imaging::write_at_points(path, series.correlation().mesh(), r, points_);
    } else if (has_ending(".vtu") && !r.missing) {
      imaging::write_displacement_vtu(arguments_.output, series, r, task_.frame);
    } else if (has_ending(".pvd") && !r.missing) {
      const std::string name = fs::path(arguments_.output).stem().string() + "_" + stems_[r.index] + ".vtu";
      imaging::write_displacement_vtu((fs::path(arguments_.output).parent_path() / name).string(), series, r,
                                      task_.frame);
      const auto& times = series.options().times;
      entries_.push_back({times.empty() ? static_cast<double>(r.index) : times[r.index], name});
      files::write_pvd(entries_, arguments_.output);
    }
  }

  void finish(const imaging::PictureSeries& series, const std::vector<PictureResult>& results) const {
    write_page(series, results);
    if (!arguments_.output.empty() && arguments_.at.empty() && has_ending(".h5"))
      imaging::write_displacements(arguments_.output, series, results, task_.frame, task_.project_text);
  }

 private:
  /// All maps on one page; of a series that goes on (--resume) those of this run.
  void write_page(const imaging::PictureSeries& series, const std::vector<PictureResult>& results) const {
    if (arguments_.maps.empty()) return;
    std::vector<report::MappedPicture> pictures;
    const std::size_t before = results.size() - noise_std_.size();
    for (std::size_t i = before; i < results.size(); ++i)
      pictures.push_back({&results[i], noise_std_[i - before],
                          results[i].correlation.iterations > 0 ? stems_[results[i].index] : std::string()});
    report::write_maps_page(arguments_.maps, series, pictures, task_.frame,
                            task_.registration ? project::registration_text(*task_.registration) : "");
  }
  [[nodiscard]] bool several() const { return task_.series.pictures.size() > 1; }
  [[nodiscard]] bool has_ending(const char* ending) const { return arguments_.output.ends_with(ending); }

  const DicArguments& arguments_;
  const Task& task_;
  std::vector<std::string> stems_;
  std::vector<double> noise_std_;  ///< px, of the pictures of this run
  Eigen::MatrixXd points_;
  std::vector<files::PvdEntry> entries_;
};

/// The outline that was fitted: a line to stderr, and a map where maps are asked for.
void tell_registration(const DicArguments& arguments, const Task& task) {
  if (!task.registration) return;
  fmt::print(stderr, "{}\n", project::registration_text(*task.registration));
  if (arguments.maps.empty()) return;
  files::require_writable_folder(arguments.maps);
  report::write_registration_map((fs::path(arguments.maps) / "registration.png").string(),
                                 files::read_picture(task.registration->picture), *task.registration);
}

void write_table(const std::string& path, const imaging::PictureSeries& series, const Task& task,
                 double noise, const Eigen::VectorXd& std) {
  auto rows = imaging::reporting_table(series, task.frame, noise, std);
  if (task.registration) rows.push_back({"Registration", project::registration_text(*task.registration), ""});
  imaging::write_reporting_table(path, rows);
}

void write_table(const std::string& path, const imaging::PictureSeries& series,
                 const std::vector<PictureResult>& results, const Task& task) {
  const double noise = std::max(imaging::k_quantisation_noise, imaging::series_noise(series, results));
  const auto precision = series.precision(series.correlation().usable_elements(), noise);
  write_table(path, series, task, noise, precision.std);
}

/// 0 if any picture was measured; otherwise why not: unreadable or unsuitable (4), or not converged (6).
int verdict(const std::vector<PictureResult>& results) {
  const bool any = std::any_of(results.begin(), results.end(), [](const auto& r) { return !r.missing; });
  if (any) return 0;
  const bool read =
      std::any_of(results.begin(), results.end(), [](const auto& r) { return r.correlation.iterations > 0; });
  return static_cast<int>(read ? ExitStatus::numerical : ExitStatus::data);
}

/// --pattern: what is to be expected of a test with this surface and camera.
int judge_pattern(const DicArguments& arguments, const Task& task) {
  if (!arguments.at.empty() || !arguments.output.empty() || arguments.resume)
    throw UsageError(
        "--pattern measures nothing: it takes --maps, --table and --json, not --at, -o or --resume");
  const imaging::PictureSeries series(task.series);
  const imaging::PatternReport r = imaging::pattern_report(series);
  if (!arguments.table.empty()) write_table(arguments.table, series, task, r.noise, r.std);
  if (!arguments.maps.empty()) {
    files::require_writable_folder(arguments.maps);
    report::write_deviation_maps((fs::path(arguments.maps) / "pattern").string(), series, r.std, task.frame);
  }
  fmt::print("{}\n", arguments.json ? files::json_line(report::pattern_record(
                                          series.options().references.front(), r, task.frame))
                                    : report::pattern_text(r, task.frame));
  return 0;
}

/// What an earlier run left in the output file; the series goes on behind it.
std::vector<PictureResult> resumed(const DicArguments& arguments, imaging::PictureSeries& series) {
  if (!arguments.resume || !fs::exists(arguments.output)) return {};
  auto results = imaging::read_results(arguments.output, series);
  imaging::CorrelationResult last;
  for (const auto& r : results)
    if (!r.missing) last = r.correlation;
  series.resume(results.size(), last);
  fmt::print(stderr, "{} of {} pictures are in {} already\n", results.size(),
             series.options().pictures.size(), arguments.output);
  return results;
}

}  // namespace

int dic(const DicArguments& arguments) {
  if (!arguments.table.empty()) imaging::require_table_name(arguments.table);
  const Task task = task_of(arguments);
  tell_registration(arguments, task);
  if (arguments.pattern) return judge_pattern(arguments, task);
  Output output(arguments, task);
  imaging::PictureSeries series(task.series);
  std::vector<PictureResult> results = resumed(arguments, series);
  auto saved = std::chrono::steady_clock::now();
  {
    Progress progress("pictures", task.series.pictures.size());
    while (!series.done() && !cancellation_requested()) {
      results.push_back(series.next());
      const PictureResult& r = results.back();
      double noise_std = 0;
      if (!r.missing)
        noise_std = series.precision(r, r.noise, r.correlation.gain).mean_std();
      else
        fmt::print(stderr, "{}\n", r.message);
      const std::string line =
          arguments.json ? files::json_line(report::picture_record(series, r, noise_std, task.frame))
                         : report::picture_text(r, noise_std, task.frame);
      if (!line.empty()) fmt::print("{}\n", line);
      if (arguments.json) std::fflush(stdout);
      output.add(series, r, noise_std);
      progress.advance_to(results.size());
      // A long series must not be lost with the machine's power.
      if (std::chrono::steady_clock::now() - saved > k_save_every) {
        output.finish(series, results);
        saved = std::chrono::steady_clock::now();
      }
    }
  }
  const int status = verdict(results);
  if (status == 0 || cancellation_requested()) output.finish(series, results);
  if (status == 0 && !arguments.table.empty()) write_table(arguments.table, series, results, task);
  if (!series.done())
    throw Interrupted(
        fmt::format("interrupted after {} of {} pictures{}", results.size(), task.series.pictures.size(),
                    arguments.output.empty() ? "" : "; their results are in " + arguments.output));
  return status;
}

}  // namespace knothe::commands
