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

namespace knothe::service {
namespace {

constexpr double k_look_every = 0.1;  // s
/// A file that cannot be read may still be being written: so many times `settle` it may rest before it counts
/// as bad.
constexpr double k_patience = 10;

constexpr std::int64_t k_coarse_clock_ms = 20;  // a file's time is that of the last tick of the system

constexpr const char* k_times = "pictures.csv";

// A file that never ends, a log that is copied here say, must not take the memory, nor keep others waiting.
constexpr std::uintmax_t k_largest_table = 64 << 20, k_largest_picture = 512 << 20;  // bytes

void require_size(const std::string& path, std::uintmax_t most) {
  std::error_code gone;
  const auto size = std::filesystem::file_size(path, gone);
  if (!gone && size > most)
    throw DataError(fmt::format("{}: the file has {} MB; at most {} are read", path, size >> 20, most >> 20));
}

bool is_live_picture(const std::string& name) {
  return imaging::is_picture_name(name) && !imaging::is_reference_name(name);
}

bool is_table(const std::string& name) {
  return files::extension_of(name) == ".csv" && !name.starts_with(".") && name != k_times;
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

}  // namespace

bool FolderWatch::is_wanted(const project::Project& project) {
  return !project.serve.watch_pictures.empty() || !project.serve.watch_csv.empty();
}

FolderWatch::FolderWatch(std::shared_ptr<Site> site)
    : site_(std::move(site)), intake_(site_, [this](double seconds) { return wait(seconds); }) {
  const project::ServeOptions& options = site_->project().serve;
  if (!options.watch_pictures.empty())
    pictures_.emplace(options.watch_pictures, options.settle, is_live_picture);
  if (!options.watch_csv.empty()) tables_.emplace(options.watch_csv, options.settle, is_table);
  const project::UpdateSetup& setup = site_->setup();
  const model::Sensors& sensors = setup.measurements.sensors;
  for (std::size_t i = 0; i < sensors.displacement_count(); ++i) sensor_at_[key_of(sensors, i)] = i;
  thread_ = std::thread([this] { run(); });
}

FolderWatch::~FolderWatch() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  end_.notify_all();
  thread_.join();
}

bool FolderWatch::wait(double seconds) {
  std::unique_lock lock(mutex_);
  return !end_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return ending_; });
}

void FolderWatch::run() {
  const double pause = std::min(k_look_every, 0.5 * site_->project().serve.settle);
  while (wait(pause)) {
    if (!site_->journal().ready()) continue;
    try {
      if (pictures_) ingest_pictures();
      if (tables_) ingest_tables();
    } catch (const std::exception& error) {
      log_event("error", "a watched folder could not be read",
                {{"site", site_->name()}, {"reason", error.what()}});
    }
  }
}

void FolderWatch::ingest_pictures() {
  for (const std::string& name : pictures_->new_files(SettledFiles::Clock::now())) {
    if (is_of_another_test(*pictures_, name) || ingest_picture(name) == StoreOutcome::done)
      pictures_->done(name);
    if (!wait(0)) return;
  }
}

void FolderWatch::ingest_tables() {
  for (const std::string& name : tables_->new_files(SettledFiles::Clock::now())) {
    if (is_of_another_test(*tables_, name) || ingest_table(name) == StoreOutcome::done) tables_->done(name);
    if (!wait(0)) return;
  }
}

/// A file that came while another test had its turn shows another specimen.
bool FolderWatch::is_of_another_test(const SettledFiles& files, const std::string& name) {
  const std::int64_t arrival = files.arrival_ms(name);
  const SiteLogbook& logbook = site_->logbook();
  if (logbook.had_turn_at(arrival) || logbook.had_turn_at(arrival + k_coarse_clock_ms)) return false;
  if (!std::exchange(told_of_others_, true))
    log_event("info", "files that came while another test had its turn are left alone",
              {{"site", site_->name()}, {"folder", files.folder()}, {"first", name}});
  return true;
}

bool FolderWatch::patient(const SettledFiles& files, const std::string& name) const {
  return files.rest(name, SettledFiles::Clock::now()) < k_patience * site_->project().serve.settle;
}

// --- Pictures --------------------------------------------------------------------------------------------

/// The picture's number and model time. DataError where neither the table of times nor its name tells.
FolderWatch::Place FolderWatch::place_of(const std::string& name) const {
  const std::string table = pictures_->path(k_times);
  std::error_code failure;
  if (std::filesystem::exists(table, failure)) {
    require_size(table, k_largest_table);
    const auto times = files::CsvTable::read(table);
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

FolderWatch::StoreOutcome FolderWatch::ingest_picture(const std::string& name) {
  Intake::PictureStamp stamp;
  try {
    const Place place = place_of(name);
    stamp.key = {k_pictures_source,
                 std::filesystem::path(pictures_->folder()).lexically_normal().filename().string(),
                 place.seq};
    if (stamp.key.session.empty()) stamp.key.session = "pictures";
    stamp.time = place.time, stamp.name = name;
    site_->pictures().show(place.time, pictures_->path(name));
  } catch (const DataError& error) {
    if (patient(*pictures_, name)) return StoreOutcome::again;  // its line in the table may still come
    intake_.refuse(name, error.what());
    return StoreOutcome::done;
  }
  if (site_->journal().holds(stamp.key)) return StoreOutcome::done;
  Intake::Measured measured;
  try {
    require_size(pictures_->path(name), k_largest_picture);
    measured = intake_.measure(
        stamp,
        files::read_picture(pictures_->path(name), site_->setup().pictures->series().options().colour));
  } catch (const DataError& error) {
    if (patient(*pictures_, name)) return StoreOutcome::again;
    measured = {intake_.missing(stamp), error.what()};
  }
  const StoreOutcome outcome = intake_.store(std::move(measured.datum), name);
  if (outcome == StoreOutcome::done && !measured.trouble.empty())
    intake_.refuse(name, "missing: " + measured.trouble);
  return outcome;
}

// --- CSV -------------------------------------------------------------------------------------------------

FolderWatch::StoreOutcome FolderWatch::ingest_table(const std::string& name) {
  std::vector<Measurement> data;
  try {
    require_size(tables_->path(name), k_largest_table);
    const likelihood::Measurements table = likelihood::read_measurements_csv(tables_->path(name));
    std::vector<std::size_t> place;
    for (std::size_t i = 0; i < table.sensors.displacement_count(); ++i) {
      const auto at = key_of(table.sensors, i);
      const auto it = sensor_at_.find(at);
      if (it == sensor_at_.end())
        throw DataError(fmt::format("{}: this site has no sensor at ({}, {}, {}) m, component {}", name,
                                    at[0], at[1], at[2], "xyz"[table.sensors.components[i]]));
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
  } catch (const DataError& error) {
    if (patient(*tables_, name)) return StoreOutcome::again;
    intake_.refuse(name, error.what());
    return StoreOutcome::done;
  }
  for (Measurement& measurement : data)
    if (intake_.store(std::move(measurement), name) == StoreOutcome::again) return StoreOutcome::again;
  return StoreOutcome::done;
}

}  // namespace knothe::service
