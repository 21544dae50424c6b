#include "knothe/service/camera/camera_watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "knothe/base/error.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/likelihood/data/time_matching.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {
namespace {

constexpr double k_look_every = 0.1, k_try_every = 1;  // s
constexpr double k_max_frame = 60;                     // s; a camera that takes longer for one hangs
constexpr const char* k_times = "pictures.csv";
/// Of alarms that hold until it is over.
constexpr const char* k_away = "camera is away";
constexpr const char* k_not_kept = "frames are not kept";

std::string range(std::int64_t first, std::int64_t count) {
  return count == 1 ? fmt::format("frame {}", first)
                    : fmt::format("frames {} to {}", first, first + count - 1);
}

}  // namespace

CameraWatch::CameraWatch(std::shared_ptr<Site> site, Metrics& metrics, Open open)
    : site_(std::move(site)),
      options_(site_->project().serve.camera),
      metrics_(metrics),
      open_(std::move(open)),
      intake_(site_, [this](double seconds) { return thread_.wait(seconds); }) {
  for (const char* what : {"frames", "incomplete_frames", "lost_frames", "reconnects"}) count(what, 0);
  metrics_.set("knothe_camera_connected", site_labels(site_->name()), 0);
  thread_.begin(site_->health().pulses().add("the watch of the camera", k_max_frame), [this] { run(); });
}

void CameraWatch::count(const std::string& what, double by) {
  metrics_.count("knothe_camera_" + what + "_total", site_labels(site_->name()), by);
}

// --- Connection ------------------------------------------------------------------------------------------

void CameraWatch::run() {
  while (!site_->journal().ready())
    if (!thread_.wait(k_look_every)) return;
  numbers_ = FrameNumbers(last_in_journal());
  prepare_folder();
  thread_.beat();
  do {
    try {
      if (!source_) connect();
      receive();
    } catch (const std::exception& error) {
      lose(error.what());
    }
  } while (thread_.wait(source_ ? 0 : k_try_every));
  source_.reset();
}

void CameraWatch::connect() {
  source_ = open_(options_);
  if (was_connected_) count("reconnects");
  was_connected_ = true;
  numbers_.begin(source_->serial(), source_->period_s());
  metrics_.set("knothe_camera_connected", site_labels(site_->name()), 1);
  site_->alarms().update_condition(k_away, intake_.latest_step(), "", "sensors", "");
  log_event("info", "connected to the camera",
            {{"site", site_->name()}, {"serial", source_->serial()}, {"camera", source_->description()}});
}

/// Says so before it lets go of the camera, which may take seconds where it does not answer.
void CameraWatch::lose(const std::string& reason) {
  metrics_.set("knothe_camera_connected", site_labels(site_->name()), 0);
  if (reason != said_)
    log_event("error", "the camera does not respond: the connection is retried",
              {{"site", site_->name()}, {"reason", reason}});
  said_ = reason;
  site_->alarms().update_condition(k_away, intake_.latest_step(), "warning", "sensors",
                                   "the camera is away: " + reason);
  source_.reset();
}

void CameraWatch::receive() {
  const auto frame = source_->next(k_look_every);
  const auto incomplete = source_->incomplete();
  if (incomplete.count > 0) {
    count("incomplete_frames", incomplete.count);
    incomplete_ = incomplete.reason;
    numbers_.skip(incomplete.count);
  }
  if (!frame) return;
  count("frames");
  ingest(*frame);
  incomplete_.clear();
  said_.clear();
}

// --- Numbers and times -----------------------------------------------------------------------------------

const std::vector<double>& CameraWatch::times() const {
  const std::vector<double>& given = site_->project().pictures.times;
  return given.empty() ? site_->setup().problem.model->time : given;
}

/// The last frame before this start.
std::optional<FrameNumbers::Numbered> CameraWatch::last_in_journal() const {
  const auto datum = site_->journal().last_frame();
  if (!datum) return std::nullopt;
  const auto index = likelihood::matching_time(datum->time, times());
  if (!index) return std::nullopt;
  return FrameNumbers::Numbered{static_cast<std::int64_t>(*index) + site_->project().serve.first_picture,
                                datum->key.session, datum->key.seq, 1000 * datum->received_ms};
}

std::optional<Intake::PictureStamp> CameraWatch::stamp_of(const FrameNumbers::Numbered& frame) {
  const std::int64_t index = frame.number - site_->project().serve.first_picture;
  if (index < 0 || site_->logbook().finished()) return std::nullopt;
  if (index < std::ssize(times()))
    return Intake::PictureStamp{
        {k_camera_source, frame.session, frame.camera_us},
        times()[index],
        fmt::format("frame_{:06}.{}", frame.number,
                    options_.keep_format == project::FrameFormat::png ? "png" : "tif")};
  if (!is_over_)
    log_event("info", "the last model time has passed: frames of the camera are no longer assimilated",
              {{"site", site_->name()}, {"number", frame.number}, {"times", times().size()}});
  is_over_ = true;
  return std::nullopt;
}

// --- Frames ----------------------------------------------------------------------------------------------

void CameraWatch::ingest(const Frame& frame) {
  const auto before = numbers_.last();
  const auto place = numbers_.place(frame.stamp);
  if (!place) return;
  if (!before && place->frame.number > 0)
    intake_.refuse(range(0, place->frame.number), fmt::format("missing: {}, the first: incomplete: {}",
                                                              range(0, place->frame.number), incomplete_));
  if (before && !place->connected) report_gap(*place, *before);
  if (before && place->connected && place->absent > 0) record_missing(*place, *before);
  ingest_picture(place->frame, frame.picture);
}

/// The camera, or the service, was away.
void CameraWatch::report_gap(const FrameNumbers::Place& place, const FrameNumbers::Numbered& before) {
  using By = FrameNumbers::Place::By;
  if (!stamp_of({before.number + 1, "", 0, 0})) return;  // they would not have been taken
  std::string said;
  if (place.absent > 0)
    said = fmt::format("{} were not seen: the camera or the service was away",
                       range(before.number + 1, place.absent));
  if (place.by == By::host_clock)
    said += fmt::format("{}the camera's clock was reset, so the number {} is by the clock of this machine",
                        said.empty() ? "" : "; ", place.frame.number);
  if (!source_->period_s())
    said += fmt::format("{}frames may have been triggered while nobody saw them: numbers go on at {}",
                        said.empty() ? "" : "; ", place.frame.number);
  if (said.empty()) return;
  log_event("warning", "frames were not seen",
            {{"site", site_->name()}, {"count", place.absent}, {"reason", said}});
  site_->alarms().raise(intake_.latest_step(), "warning", "gap", said);
}

/// They were lost on the way here, or there was no room for them.
void CameraWatch::record_missing(const FrameNumbers::Place& place, const FrameNumbers::Numbered& before) {
  count("lost_frames", place.absent);
  bool counts = false;
  for (std::int64_t i = 1; i <= place.absent && thread_.wait(0); ++i) {
    const auto stamp = stamp_of(FrameNumbers::absent(place, before, i));
    if (!stamp) continue;
    counts = true;
    store(intake_.missing(*stamp), *stamp);
  }
  const std::string name = range(before.number + 1, place.absent);
  const std::string reason = incomplete_.empty() ? "did not come" : "incomplete: " + incomplete_;
  if (counts) intake_.refuse(name, fmt::format("missing: {}: {}", name, reason));
}

void CameraWatch::ingest_picture(const FrameNumbers::Numbered& frame, const files::Picture& picture) {
  const auto stamp = stamp_of(frame);
  if (!stamp) return;
  save_picture(*stamp, picture);
  Intake::Measured measured = intake_.measure(*stamp, picture);
  store(std::move(measured.datum), *stamp);
  if (!measured.trouble.empty()) intake_.refuse(stamp->name, "missing: " + measured.trouble);
}

/// Until it is on disk, or it is time to end: then it is one of those that were not seen.
void CameraWatch::store(Measurement datum, const Intake::PictureStamp& stamp) {
  while (intake_.store(datum, stamp.name) == Intake::StoreOutcome::again)
    if (!thread_.wait(k_look_every)) return;
  note_kept(stamp);
}

// --- Frames that are kept --------------------------------------------------------------------------------

void CameraWatch::prepare_folder() {
  if (options_.keep.empty()) return;
  const std::filesystem::path folder(options_.keep);
  try {
    std::filesystem::create_directories(folder);
    if (!std::filesystem::exists(folder / k_times)) {
      std::ofstream(folder / k_times) << "time,file\n";
      return;
    }
    const auto table = files::CsvTable::read((folder / k_times).string());
    const auto names = table.texts("file");
    const auto seen = table.numbers("time");
    for (std::size_t i = 0; i < names.size(); ++i)
      site_->pictures().show(seen[i], (folder / names[i]).string());
    // Killed between the journal and the table: the last frame has no line yet.
    const auto last = numbers_.last() ? stamp_of(*numbers_.last()) : std::nullopt;
    if (!last || (names.empty() ? !std::filesystem::exists(folder / last->name) : names.back() == last->name))
      return;
    note_kept(*last);
    site_->pictures().show(last->time, (folder / last->name).string());
  } catch (const std::exception& error) {
    intake_.refuse(options_.keep, fmt::format("frames cannot be kept: {}", error.what()));
  }
}

void CameraWatch::save_picture(const Intake::PictureStamp& stamp, const files::Picture& picture) {
  if (options_.keep.empty()) return;
  const std::string path = (std::filesystem::path(options_.keep) / stamp.name).string();
  try {
    options_.keep_format == project::FrameFormat::png ? files::write_png(path, picture)
                                                      : files::write_tiff(path, picture);
    site_->pictures().show(stamp.time, path);
    site_->alarms().update_condition(k_not_kept, intake_.latest_step(), "", "sensors", "");
  } catch (const Error& error) {
    site_->alarms().update_condition(k_not_kept, intake_.latest_step(), "warning", "sensors",
                                     fmt::format("frames are measured but not kept: {}", error.what()));
  }
}

/// One line of the table, also of a frame that is missing: so `knothe assimilate` reads the folder as it was.
void CameraWatch::note_kept(const Intake::PictureStamp& stamp) {
  if (options_.keep.empty()) return;
  std::ofstream table(std::filesystem::path(options_.keep) / k_times, std::ios::app);
  table << fmt::format("{},{}\n", stamp.time, stamp.name);
}

}  // namespace knothe::service
