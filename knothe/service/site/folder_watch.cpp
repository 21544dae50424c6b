#include "knothe/service/site/folder_watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/files/extension.hpp"
#include "knothe/files/picture.hpp"
#include "knothe/imaging/series/picture_folder.hpp"
#include "knothe/likelihood/data/measurements_csv.hpp"
#include "knothe/likelihood/data/time_matching.hpp"
#include "knothe/service/site/log.hpp"
#include "knothe/service/site/regular_file.hpp"

namespace knothe::service {
namespace {

constexpr double k_look_every = 0.1;  // s
constexpr double k_max_file = 60;     // s; who takes longer for one hangs
/// A file that cannot be read may still be being written: so many times `settle` it may rest before it counts
/// as bad.
constexpr double k_patience = 10;

constexpr const char* k_times = "pictures.csv";

// A file that never ends, a log that is copied here say, must not take the memory, nor keep others waiting.
constexpr std::uintmax_t k_max_table = 64 << 20, k_max_picture = 512 << 20;  // bytes

bool is_live_picture(const std::string& name) {
  return imaging::is_picture_name(name) && !imaging::is_reference_name(name);
}

bool is_table(const std::string& name) {
  return files::extension_of(name) == ".csv" && !name.starts_with(".") && name != k_times;
}

/// A name that no folder takes, whatever is left there.
bool is_foreign(const std::string& name) {
  return !name.starts_with(".") && !imaging::is_picture_name(name) && files::extension_of(name) != ".csv";
}

/// Point and component of a sensor.
std::array<double, 4> key_of(const model::Sensors& sensors, std::size_t i) {
  const auto at = sensors.point(i);
  const double component = sensors.components[i];
  return {at[0], at[1], at[2], component};
}

/// The last number in a name.
std::optional<std::int64_t> number_in(const std::string& name) {
  const std::string stem = std::filesystem::path(name).stem().string();
  const auto last = stem.find_last_of("0123456789");
  if (last == std::string::npos) return std::nullopt;
  const auto before = stem.find_last_not_of("0123456789", last);
  const std::size_t first = before == std::string::npos ? 0 : before + 1;
  std::int64_t number = 0;
  const auto parsed = std::from_chars(stem.data() + first, stem.data() + last + 1, number);
  return parsed.ec == std::errc() ? std::optional(number) : std::nullopt;
}

/// What is watched: a folder, the source of its data, which names count, the largest file.
struct Watched {
  std::string folder;
  const char* source;
  bool (*wanted)(const std::string&);
};
std::vector<Watched> watched_by(const project::Project& project) {
  std::vector<Watched> all;
  const project::ServeOptions& options = project.serve;
  if (!options.watch_pictures.empty())
    all.push_back({options.watch_pictures, k_pictures_source, is_live_picture});
  if (!options.watch_csv.empty()) all.push_back({options.watch_csv, k_csv_source, is_table});
  return all;
}

std::uintmax_t max_bytes(const std::string& source) {
  return source == k_pictures_source ? k_max_picture : k_max_table;
}

}  // namespace

std::vector<JournalFile> files_there(const project::Project& project, const FileRegister& known) {
  std::vector<JournalFile> files;
  for (const auto& [folder, source, wanted] : watched_by(project)) {
    for (const std::string& name : content_of(folder, wanted, is_foreign).names) {
      std::string digest = known.digest_of(source, name);
      try {
        if (digest.empty())
          digest = RegularFile((std::filesystem::path(folder) / name).string(), max_bytes(source)).digest();
        files.push_back({source, name, digest, FileOutcome::elsewhere, -1});
      } catch (const DataError&) {
        // It is gone, or no file: who looks at the folder says so.
      }
    }
  }
  return files;
}

bool FolderWatch::is_wanted(const project::Project& project) {
  return !project.serve.watch_pictures.empty() || !project.serve.watch_csv.empty();
}

FolderWatch::FolderWatch(std::shared_ptr<Site> site)
    : site_(std::move(site)), intake_(site_, [this](double seconds) { return thread_.wait(seconds); }) {
  for (const auto& [folder, source, wanted] : watched_by(site_->project()))
    folders_.push_back({source, SettledFiles(folder, site_->project().serve.settle, wanted, is_foreign)});
  const project::UpdateSetup& setup = site_->setup();
  const model::Sensors& sensors = setup.measurements.sensors;
  for (std::size_t i = 0; i < sensors.displacement_count(); ++i) sensor_at_[key_of(sensors, i)] = i;
  thread_.begin(site_->health().pulses().add("the watch of folders", k_max_file), [this] { run(); });
}

void FolderWatch::run() {
  const double pause = std::min(k_look_every, 0.5 * site_->project().serve.settle);
  while (thread_.wait(pause)) {
    if (!site_->journal().ready()) continue;
    for (Folder& folder : folders_) ingest(folder);
  }
}

/// What cannot be looked at, and what nobody will take: once, while it is so.
void FolderWatch::tell_of_what_is_left(const Folder& folder) {
  const SettledFiles& files = folder.files;
  const auto tell = [&](const std::string& what, const std::string& severity, const std::string& message) {
    site_->alarms().update_condition(what + " of " + folder.source, intake_.latest_step(), severity,
                                     "sensors", message);
  };
  tell("folder", files.trouble().empty() ? "" : "alarm",
       fmt::format("the watched folder {} cannot be read: {}; what is left there waits until it can",
                   files.folder(), files.trouble()));
  tell("names", files.foreign().empty() ? "" : "info",
       fmt::format("{} is not taken: {}", files.path(files.foreign()),
                   folder.source == k_csv_source ? "tables have names that end in .csv"
                                                 : fmt::format("pictures have names that end in {}",
                                                               fmt::join(files::picture_endings(), ", "))));
}

/// One file after the other: whatever is wrong with one, the next has its turn.
void FolderWatch::ingest(Folder& folder) {
  const auto names = folder.files.new_files(SettledFiles::Clock::now());
  tell_of_what_is_left(folder);
  for (const std::string& name : names) {
    thread_.beat();
    JournalFile file{folder.source, name, "", FileOutcome::taken, -1};
    std::string trouble;
    StoreOutcome outcome = StoreOutcome::refused;
    try {
      outcome = ingest(folder, file);
    } catch (const std::bad_alloc&) {
      trouble = fmt::format("{}: there is not enough memory for it", name);
    } catch (const std::exception& error) {
      trouble = error.what();
    }
    // What cannot be read may still be being written; its line in the table of times may still come.
    if (!trouble.empty() && patient(folder, name)) outcome = StoreOutcome::again;
    if (outcome == StoreOutcome::refused) file.outcome = FileOutcome::refused;
    if (outcome == StoreOutcome::refused && !trouble.empty() && !is_known(file))
      intake_.refuse(name, trouble);
    if (outcome != StoreOutcome::again) {
      if (!is_known(file)) site_->journal().note(file);
      folder.files.done(name);
    }
    if (!thread_.wait(0)) return;
  }
}

bool FolderWatch::is_known(const JournalFile& file) const {
  const FileRegister& files = site_->journal().files();
  return files.settled(file) == file.outcome && files.digest_of(file.source, file.name) == file.digest;
}

FolderWatch::StoreOutcome FolderWatch::ingest(Folder& folder, JournalFile& file) {
  const RegularFile opened(folder.files.path(file.name), max_bytes(file.source));
  file.digest = opened.digest();
  // What was refused is tried again: its line may be in the table of times by now.
  if (const auto known = site_->journal().files().settled(file); known && *known != FileOutcome::refused) {
    file.outcome = *known;
    if (*known == FileOutcome::elsewhere) tell_of_others(folder, file.name);
    if (*known == FileOutcome::taken && file.source == k_pictures_source) show(folder, file.name);
    return StoreOutcome::done;
  }
  return file.source == k_pictures_source ? ingest_picture(folder, opened, file) : ingest_table(opened, file);
}

/// Files that were there before the test was begun show another specimen.
void FolderWatch::tell_of_others(const Folder& folder, const std::string& name) {
  if (!std::exchange(told_of_others_, true))
    log_event("info", "files that came while another test had its turn are left alone",
              {{"site", site_->name()}, {"folder", folder.files.folder()}, {"first", name}});
}

bool FolderWatch::patient(const Folder& folder, const std::string& name) const {
  return folder.files.rest(name, SettledFiles::Clock::now()) < k_patience * site_->project().serve.settle;
}

// --- Pictures --------------------------------------------------------------------------------------------

/// The picture's number and model time. DataError where neither the table of times nor its name tells.
FolderWatch::Place FolderWatch::place_of(const Folder& folder, const std::string& name) const {
  const std::string table = folder.files.path(k_times);
  std::error_code failure;
  if (std::filesystem::exists(std::filesystem::symlink_status(table, failure))) {
    const auto times = files::CsvTable::parse(RegularFile(table, k_max_table).content(), table);
    const auto names = times.texts("file");
    const auto it = std::find(names.begin(), names.end(), name);
    if (it == names.end()) throw DataError(fmt::format("{}: {} does not say its time", name, table));
    return {it - names.begin(), times.numbers("time")[it - names.begin()]};
  }
  const auto number = number_in(name);
  if (!number)
    throw DataError(
        fmt::format("{}: neither a number in its name nor a table {} says its time", name, k_times));
  const std::int64_t index = *number - site_->project().serve.first_picture;
  const std::vector<double>& given = site_->project().pictures.times;
  const std::vector<double>& times = given.empty() ? site_->setup().problem.model->time : given;
  if (index < 0 || index >= std::ssize(times))
    throw DataError(
        fmt::format("{}: picture number {} would have time number {} of {} (serve.first_picture is {})", name,
                    *number, index + 1, times.size(), site_->project().serve.first_picture));
  return {*number, times[index]};
}

/// The file of a picture that is in the journal.
void FolderWatch::show(const Folder& folder, const std::string& name) {
  try {
    site_->pictures().show(place_of(folder, name).time, folder.files.path(name));
  } catch (const DataError&) {
    // The table of times has lost its line: there is no picture to show.
  }
}

/// What is far larger than the reference is refused by its header: it could take all the memory.
files::Picture FolderWatch::read(const RegularFile& file) const {
  const imaging::PictureSeries& series = site_->setup().pictures->series();
  const files::Picture& reference = series.correlation().reference();
  try {
    return files::read_picture(file.own_path(), series.options().colour, std::ssize(reference.pixels));
  } catch (const DataError& error) {
    std::string reason = error.what();
    if (const auto at = reason.find(file.own_path()); at != std::string::npos)
      reason.replace(at, file.own_path().size(), file.path());
    throw DataError(reason);
  } catch (const std::bad_alloc&) {
    throw DataError(fmt::format("{}: there is not enough memory for it", file.path()));
  }
}

/// A datum has one file. Why another has none, and what to do.
std::string FolderWatch::complaint(const std::string& name, const std::string& holder,
                                   std::int64_t seq) const {
  if (name == holder)
    return fmt::format(
        "{}: has changed after it was read: what was read stays; withdraw that, and give the "
        "corrected picture another name",
        name);
  return fmt::format(
      "{}: is not taken: its number {} is that of {}, whose datum is in the journal; give each "
      "picture a number of its own at the end of its name, or list all in {}",
      name, seq, holder, k_times);
}

FolderWatch::StoreOutcome FolderWatch::ingest_picture(const Folder& folder, const RegularFile& opened,
                                                      JournalFile& file) {
  const std::string& name = file.name;
  const Place place = place_of(folder, name);
  Intake::PictureStamp stamp;
  stamp.key = {k_pictures_source,
               std::filesystem::path(folder.files.folder()).lexically_normal().filename().string(),
               place.seq};
  if (stamp.key.session.empty()) stamp.key.session = "pictures";
  stamp.time = place.time, stamp.name = name;
  file.seq = place.seq;
  if (const auto holder = site_->journal().files().holder(stamp.key); holder && !holder->empty())
    throw DataError(complaint(name, *holder, place.seq));
  else if (holder) {  // of a journal of a time without files
    site_->pictures().show(place.time, opened.path());
    return StoreOutcome::done;
  }
  Intake::Measured measured;
  try {
    measured = intake_.measure(stamp, read(opened));
  } catch (const DataError& error) {
    if (patient(folder, name)) return StoreOutcome::again;
    measured = {intake_.missing(stamp), error.what()};
  }
  const StoreOutcome outcome = intake_.store(std::move(measured.datum), name, file);
  if (outcome == StoreOutcome::done) site_->pictures().show(place.time, opened.path());
  if (outcome == StoreOutcome::done && !measured.trouble.empty())
    intake_.refuse(name, "missing: " + measured.trouble);
  return outcome;
}

// --- CSV -------------------------------------------------------------------------------------------------

FolderWatch::StoreOutcome FolderWatch::ingest_table(const RegularFile& opened, const JournalFile& file) {
  const std::string& name = file.name;
  std::vector<Measurement> data;
  const likelihood::Measurements table =
      likelihood::read_measurements_csv(files::CsvTable::parse(opened.content(), opened.path()));
  std::vector<std::size_t> place;
  for (std::size_t i = 0; i < table.sensors.displacement_count(); ++i) {
    const auto at = key_of(table.sensors, i);
    const auto it = sensor_at_.find(at);
    if (it == sensor_at_.end())
      throw DataError(fmt::format("{}: this site has no sensor at ({}, {}, {}) m, component {}", name, at[0],
                                  at[1], at[2], "xyz"[table.sensors.components[i]]));
    place.push_back(it->second);
  }
  const std::vector<std::string>& scalars = site_->setup().measurements.sensors.scalars;
  const std::size_t behind = site_->setup().measurements.sensors.displacement_count();
  const std::vector<std::string>& unused = site_->setup().unused;
  const auto among = [](const std::vector<std::string>& names, const std::string& series) {
    return std::find(names.begin(), names.end(), series) != names.end();
  };
  for (const auto& [series, values] : table.series)
    if (!among(scalars, series) && !among(unused, series))
      throw DataError(
          fmt::format("{}: this site does not take \"{}\"{}", name, series, did_you_mean(series, scalars)));
  const auto steps = likelihood::match_times(table.time, site_->setup().problem.model->time, name);
  const std::size_t sensors = site_->setup().measurements.observation_count();
  for (std::size_t t = 0; t < steps.size(); ++t) {
    Measurement measurement;
    measurement.key = {k_csv_source, name, static_cast<std::int64_t>(steps[t])};
    measurement.time = table.time[t];
    measurement.values.assign(sensors, std::numeric_limits<double>::quiet_NaN());
    for (std::size_t i = 0; i < place.size(); ++i) measurement.values[place[i]] = table.values(i, t);
    for (std::size_t i = 0; i < scalars.size(); ++i)
      if (const auto it = table.series.find(scalars[i]); it != table.series.end())
        measurement.values[behind + i] = it->second.values[t];
    measurement.status.assign(measurement.values.size(), 0);
    for (std::size_t i = 0; i < measurement.values.size(); ++i)
      measurement.status[i] = std::isnan(measurement.values[i]) ? 1 : 0;
    data.push_back(std::move(measurement));
  }
  StoreOutcome all = StoreOutcome::done;
  for (Measurement& measurement : data) {
    const StoreOutcome outcome = intake_.store(std::move(measurement), name);
    if (outcome == StoreOutcome::again) return outcome;
    if (outcome == StoreOutcome::refused) all = outcome;
  }
  return all;
}

}  // namespace knothe::service
