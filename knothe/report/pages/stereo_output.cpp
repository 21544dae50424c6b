#include "knothe/report/pages/stereo_output.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/vtu.hpp"
#include "knothe/imaging/correlation/correlation_noise.hpp"
#include "knothe/imaging/series/displacement_files.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/record/picture_record.hpp"
#include "knothe/report/figures/displacement_maps.hpp"

namespace knothe::report {
namespace {

namespace fs = std::filesystem;

void check_stereo_files(const PictureFiles& files, std::size_t pictures) {
  if (!files.at.empty() || !files.table.empty() || files.std)
    throw UsageError("--at, --std and --table are for one camera; with --cameras use -o");
  const auto ends = [&](const char* ending) { return files.output.ends_with(ending); };
  if (!files.output.empty() && !ends(".h5") && !ends(".vtu") && !ends(".pvd"))
    throw UsageError(fmt::format("-o {}: takes .h5, .vtu or .pvd", files.output));
  if (ends(".vtu") && pictures > 1) throw UsageError("-o: several pictures need a series, .pvd");
  if (files.resume && !ends(".h5")) throw UsageError("--resume needs -o FILE.h5, what it goes on with");
  if (!files.maps.empty()) files::require_writable_folder(files.maps);
}

/// The fields of each set as they come.
void write_fields(const PictureFiles& files, const imaging::StereoSeries& series,
                  const imaging::StereoResult& result, std::vector<files::PvdEntry>& entries) {
  if (result.missing) return;
  if (files.output.ends_with(".vtu")) imaging::write_stereo_vtu(files.output, series, result);
  if (!files.output.ends_with(".pvd")) return;
  const fs::path output = files.output;
  const std::string name = fmt::format("{}_{}.vtu", output.stem().string(), result.index);
  imaging::write_stereo_vtu((output.parent_path() / name).string(), series, result);
  entries.push_back({imaging::time_of(series.camera(0), result.index), name});
  files::write_pvd(entries, files.output);
}

int stereo_status(const std::vector<imaging::StereoResult>& results) {
  const auto any = [&](auto&& holds) { return std::any_of(results.begin(), results.end(), holds); };
  return exit_status(any([](const auto& r) { return !r.missing; }), any([](const auto& r) {
                       return std::all_of(r.pictures.begin(), r.pictures.end(),
                                          [](const auto& p) { return p.correlation.iterations > 0; });
                     }));
}

}  // namespace

std::vector<imaging::SeriesOptions> listed_series(const imaging::SeriesOptions& first,
                                                  const std::vector<std::string>& others) {
  const Index each = 1 + std::ssize(first.pictures), count = std::ssize(others);
  if (count == 0 || count % each != 0)
    throw UsageError(
        fmt::format("--other takes the pictures of the further cameras, {} of each: its reference, "
                    "then the deformed ones in the same order; {} are given",
                    each, count));
  std::vector<imaging::SeriesOptions> cameras{first};
  for (auto at = others.begin(); at != others.end(); at += each) {
    cameras.push_back(first);
    cameras.back().references = {*at};
    cameras.back().pictures.assign(at + 1, at + each);
  }
  return cameras;
}

int measure_cameras(const imaging::StereoOptions& task, const std::string& project_text,
                    const PictureFiles& files, const files::CommandOutput* output) {
  check_stereo_files(files, task.series.front().pictures.size());
  imaging::StereoSeries series(task);
  fmt::print(stderr, "{} cameras, {} nodes; lines of sight miss each other by {:.3g} px (root mean square)\n",
             task.cameras.size(), series.surface().points.cols(), series.surface().epipolar_rms);
  for (const std::string& text : series.remarks()) fmt::print(stderr, "{}\n", text);
  const std::vector<std::string>& pictures = task.series.front().pictures;
  const std::vector<std::string> stems = stems_of(pictures);
  std::vector<imaging::StereoResult> results;
  std::vector<files::PvdEntry> entries;
  if (files.resume && fs::exists(files.output)) {
    results = imaging::resume_from(files.output, series);
    fmt::print(stderr, "{} of {} sets of pictures are in {} already\n", results.size(), pictures.size(),
               files.output);
  }
  const auto save = [&] {
    if (stereo_status(results) == 0 && files.output.ends_with(".h5"))
      imaging::write_stereo_displacements(files.output, series, results, project_text);
  };
  auto saved = std::chrono::steady_clock::now();
  {
    Progress progress("pictures", pictures.size());
    while (!series.done() && !cancellation_requested()) {
      results.push_back(series.next());
      imaging::StereoResult& r = results.back();
      if (r.missing) fmt::print(stderr, "{}\n", r.message);
      const std::string text = record::stereo_text(r);
      if (output != nullptr)
        output->line(record::stereo_record(series, r), text);
      else if (!text.empty())
        fmt::print(stderr, "{}\n", text);
      if (!files.maps.empty() && !r.missing)
        write_surface_maps((fs::path(files.maps) / stems[r.index]).string(), series, r);
      write_fields(files, series, r, entries);
      r.motion.precision = {};  // made again for the file: it is larger than all else
      progress.advance_to(results.size());
      if (std::chrono::steady_clock::now() - saved > k_save_every)
        save(), saved = std::chrono::steady_clock::now();
    }
  }
  save();
  if (!series.done()) throw Interrupted(fmt::format("interrupted after {} sets of pictures", results.size()));
  return stereo_status(results);
}

void measure_first(project::Project& project) {
  files::require_writable_folder(project.results);
  PictureTask task = picture_task(project);
  imaging::SeriesOptions& first = task.cameras->series.front();
  if (first.times.empty() && !project.model.empty()) {
    first.times = model::SeparatedModel::load(project.model).contents().time;
    if (first.times.size() < first.pictures.size())
      throw project.error_at("data",
                             fmt::format("{} pictures, but the model has {} times: give \"data.times\"",
                                         first.pictures.size(), first.times.size()));
    first.times.resize(first.pictures.size());
  }
  PictureFiles files;
  files.output = (fs::path(project.results) / "displacements.h5").string();
  if (measure_cameras(*task.cameras, project.text, files, nullptr) != 0)
    throw DataError(
        fmt::format("none of the {} sets of pictures could be measured: what is wrong with each is "
                    "said above",
                    first.pictures.size()));
  project.data = files.output, project.pictures = {};
}

}  // namespace knothe::report
