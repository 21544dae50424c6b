#include "knothe/report/pages/picture_output.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <vector>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/files/vtu.hpp"
#include "knothe/imaging/series/displacement_files.hpp"
#include "knothe/imaging/series/pattern_report.hpp"
#include "knothe/project/picture_measurements.hpp"
#include "knothe/project/picture_registration.hpp"
#include "knothe/record/picture_record.hpp"
#include "knothe/report/figures/displacement_maps.hpp"
#include "knothe/report/figures/registration_map.hpp"
#include "knothe/report/pages/maps_page.hpp"
#include "knothe/report/pages/stereo_output.hpp"

namespace knothe::report {
namespace {

namespace fs = std::filesystem;
using imaging::PictureResult;

/// Writes what was asked for, picture by picture.
class PictureOutput {
 public:
  PictureOutput(const PictureTask& task, const PictureFiles& files)
      : files_(files), task_(task), stems_(stems_of(task.series.pictures)) {
    if (!files.at.empty()) {
      if (files.output.empty())
        throw UsageError("--at needs -o: a CSV file, or a folder for several pictures");
      files::refuse_overwriting(files.output, {files.at});
      const files::CsvTable table = files::CsvTable::read(files.at);
      const auto x = table.numbers("x"), y = table.numbers("y");
      points_.resize(std::ssize(x), 2);
      for (std::size_t i = 0; i < x.size(); ++i) points_.row(i) << x[i], y[i];
      if (several() && fs::path(files.output).has_extension() && !fs::is_directory(files.output))
        throw UsageError(
            fmt::format("-o {}: with --at and several pictures it takes a folder, whose name has no ending",
                        files.output));
      if (several()) files::require_writable_folder(files.output);
    } else if (!files.output.empty() && !has_ending(".h5") && !has_ending(".vtu") && !has_ending(".pvd")) {
      throw UsageError(fmt::format(
          "-o {}: without --at it takes an HDF5 file (.h5), a field file (.vtu), or a series of them (.pvd)",
          files.output));
    } else if (has_ending(".vtu") && several()) {
      throw UsageError("-o: several pictures need a series, .pvd");
    }
    if (files.std && files.at.empty()) throw UsageError("--std needs --at: it adds columns to that table");
    if (files.resume && !has_ending(".h5"))
      throw UsageError("--resume needs -o FILE.h5, what it goes on with");
    if (!files.maps.empty()) files::require_writable_folder(files.maps);
  }

  /// `std` of the displacements, px, and their mean.
  void add(const imaging::PictureSeries& series, const PictureResult& r, const Eigen::VectorXd& std,
           double noise_std) {
    noise_std_.push_back(noise_std);
    const fs::path output = files_.output;
    if (!files_.maps.empty() && r.correlation.iterations > 0)  // also to see why it did not converge
      write_displacement_maps((fs::path(files_.maps) / stems_[r.index]).string(), series, r, noise_std,
                              task_.frame);
    if (output.empty() || r.missing) return;
    if (!files_.at.empty()) {
      const fs::path path = several() ? output / (stems_[r.index] + ".csv") : output;
      imaging::write_at_points(path.string(), series.correlation().mesh(), r, points_,
                               files_.std ? imaging::point_std(series, r, points_) : Eigen::MatrixXd());
    } else if (has_ending(".vtu")) {
      imaging::write_displacement_vtu(files_.output, series, r, std, task_.frame);
    } else if (has_ending(".pvd")) {
      const std::string name = output.stem().string() + "_" + stems_[r.index] + ".vtu";
      imaging::write_displacement_vtu((output.parent_path() / name).string(), series, r, std, task_.frame);
      entries_.push_back({imaging::time_of(series, r.index), name});
      files::write_pvd(entries_, files_.output);
    }
  }

  /// What holds several pictures: the page of maps (of a series that goes on those of this run), and HDF5.
  void finish(const imaging::PictureSeries& series, const std::vector<PictureResult>& results) const {
    if (!files_.maps.empty()) {
      std::vector<MappedPicture> pictures;
      const std::size_t before = results.size() - noise_std_.size();
      for (std::size_t i = before; i < results.size(); ++i)
        pictures.push_back(
            {&results[i], noise_std_[i - before],
             results[i].correlation.iterations > 0 ? stems_[results[i].index] : std::string()});
      write_maps_page(files_.maps, series, pictures, task_.frame,
                      task_.registration ? project::registration_text(*task_.registration) : "");
    }
    if (files_.at.empty() && has_ending(".h5"))
      imaging::write_displacements(files_.output, series, results, task_.frame, task_.project_text);
  }

 private:
  [[nodiscard]] bool several() const { return task_.series.pictures.size() > 1; }
  [[nodiscard]] bool has_ending(const char* ending) const { return files_.output.ends_with(ending); }

  const PictureFiles& files_;
  const PictureTask& task_;
  std::vector<std::string> stems_;
  std::vector<double> noise_std_;  ///< px, of the pictures of this run
  Eigen::MatrixXd points_;
  std::vector<files::PvdEntry> entries_;
};

/// The outline that was fitted: a line to stderr, and a map where maps are asked for.
void show_registration(const PictureTask& task, const PictureFiles& files) {
  if (!task.registration) return;
  fmt::print(stderr, "{}\n", project::registration_text(*task.registration));
  if (files.maps.empty()) return;
  files::require_writable_folder(files.maps);
  write_registration_map((fs::path(files.maps) / "registration.png").string(),
                         files::read_picture(task.registration->picture), *task.registration);
}

void write_table(const PictureTask& task, const PictureFiles& files, const imaging::PictureSeries& series,
                 double noise, const Eigen::VectorXd& std) {
  if (files.table.empty()) return;
  auto rows = imaging::reporting_table(series, task.frame, noise, std);
  if (task.registration) rows.push_back({"Registration", project::registration_text(*task.registration), ""});
  imaging::write_reporting_table(files.table, rows);
}

int series_status(const std::vector<PictureResult>& results) {
  const auto any = [&](auto&& holds) { return std::any_of(results.begin(), results.end(), holds); };
  return exit_status(any([](const auto& r) { return !r.missing; }),
                     any([](const auto& r) { return r.correlation.iterations > 0; }));
}

/// What an earlier run left in the output file; the series goes on behind it.
std::vector<PictureResult> resumed(const PictureFiles& files, imaging::PictureSeries& series) {
  if (!files.resume || !fs::exists(files.output)) return {};
  auto results = imaging::read_results(files.output, series);
  imaging::CorrelationResult last;
  for (const auto& r : results)
    if (!r.missing) last = r.correlation;
  series.resume(results.size(), last);
  fmt::print(stderr, "{} of {} pictures are in {} already\n", results.size(),
             series.options().pictures.size(), files.output);
  return results;
}

/// Remarks of the series that are new.
void show_remarks(const imaging::PictureSeries& series, std::size_t& shown) {
  for (; shown < series.remarks().size(); ++shown) fmt::print(stderr, "{}\n", series.remarks()[shown]);
}

}  // namespace

std::vector<std::string> stems_of(const std::vector<std::string>& pictures) {
  std::vector<std::string> stems;
  for (const std::string& picture : pictures) {
    std::string stem = fs::path(picture).stem().string();
    if (const auto page = picture.rfind('#'); page != std::string::npos && !fs::exists(picture))
      stem += "_" + picture.substr(page + 1);
    if (std::find(stems.begin(), stems.end(), stem) != stems.end()) stem += fmt::format("_{}", stems.size());
    stems.push_back(stem);
  }
  return stems;
}

PictureTask picture_task(project::Project project) {
  std::optional<model::Mesh> mesh;
  const bool by_points = !project.pictures.cameras.empty() && !project.pictures.pixels.empty();
  if (!project.model.empty() &&
      (project.pictures.model_mesh || by_points || project::needs_model_outline(project)))
    mesh = model::SeparatedModel::load(project.model).contents().mesh;
  PictureTask task;
  task.project_text = project.text;
  if (const project::PictureOptions& p = project.pictures; !p.cameras.empty()) {
    task.cameras = imaging::cameras_in_metres(p.cameras, p.camera_unit, p.calibration_std);
    task.cameras->series = project::camera_series_options(project);
    const std::string registered = project::register_cameras(project, mesh, *task.cameras);
    if (!registered.empty()) fmt::print(stderr, "{}\n", registered);
    task.series = task.cameras->series.front();
    return task;
  }
  task.registration = project::register_pictures(project, mesh);
  task.series = project::series_options(project, mesh);
  if (project.pictures.frame) task.frame = project::picture_frame_of(project, mesh);
  return task;
}

int measure_pictures(const PictureTask& task, const PictureFiles& files, const files::CommandOutput& output) {
  if (task.cameras) return measure_cameras(*task.cameras, task.project_text, files, &output);
  show_registration(task, files);
  PictureOutput written(task, files);
  imaging::PictureSeries series(task.series);
  std::size_t remarks = 0;
  show_remarks(series, remarks);
  std::vector<PictureResult> results = resumed(files, series);
  auto saved = std::chrono::steady_clock::now();
  {
    Progress progress("pictures", task.series.pictures.size());
    while (!series.done() && !cancellation_requested()) {
      results.push_back(series.next());
      const PictureResult& r = results.back();
      show_remarks(series, remarks);
      if (r.missing) fmt::print(stderr, "{}\n", r.message);
      const Eigen::VectorXd std = series.displacement_std(r);
      const double noise_std = imaging::mean_std(std);
      output.line(record::picture_record(series, r, noise_std, task.frame),
                  record::picture_text(r, noise_std, task.frame));
      written.add(series, r, std, noise_std);
      progress.advance_to(results.size());
      if (std::chrono::steady_clock::now() - saved > k_save_every) {
        written.finish(series, results);
        saved = std::chrono::steady_clock::now();
      }
    }
  }
  const int status = series_status(results);
  if (status == 0 && files.output.empty() && files.maps.empty() && !output.json())
    fmt::print(stderr,
               "the fields are not kept: -o FILE.h5, .vtu or .pvd writes them, --maps FOLDER draws them\n");
  if (status == 0 || cancellation_requested()) written.finish(series, results);
  if (status == 0 && !files.table.empty()) {
    const double noise = std::max(imaging::k_quantisation_noise, imaging::series_noise(series, results));
    write_table(task, files, series, noise,
                series.precision(series.correlation().usable_elements(), noise).std);
  }
  if (!series.done())
    throw Interrupted(fmt::format("interrupted after {} of {} pictures{}", results.size(),
                                  task.series.pictures.size(),
                                  files.output.empty() ? "" : "; their results are in " + files.output));
  return status;
}

void assess_pattern(const PictureTask& task, const PictureFiles& files, const files::CommandOutput& output) {
  show_registration(task, files);
  if (!files.at.empty() || !files.output.empty() || files.resume)
    throw UsageError(
        "--pattern measures nothing: it takes --maps, --table and --json, not --at, -o or --resume");
  const imaging::PictureSeries series(task.series);
  std::size_t remarks = 0;
  show_remarks(series, remarks);
  const imaging::PatternReport pattern = imaging::pattern_report(series);
  write_table(task, files, series, pattern.noise, pattern.std);
  if (!files.maps.empty()) {
    files::require_writable_folder(files.maps);
    write_deviation_maps((fs::path(files.maps) / "pattern").string(), series, pattern.std, task.frame);
  }
  output.line(record::pattern_record(series.options().references.front(), pattern, task.frame),
              record::pattern_text(pattern, task.frame));
}

}  // namespace knothe::report
