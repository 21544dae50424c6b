#include "knothe/service/site/site.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/assimilation/data/time_matching.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/service/journal/sqlite.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {
namespace {

constexpr std::size_t k_largest_group = 256;   // measurements in one commit
constexpr std::size_t k_longest_queue = 4096;  // then 503: memory is not for ever
constexpr double k_largest_value = 1e60;       // in standard deviations: its square must not overflow

/// What the data mean: where the sensors are, and their noise as the likelihood sees it.
std::string sensors_hash(const project::UpdateSetup& setup) {
  Sha256 sum;
  for (const double x : setup.measurements.sensors.points) sum.add_number(x);
  for (const std::int64_t c : setup.measurements.sensors.components) sum.add_number(c);
  for (const std::string& name : setup.measurements.sensors.scalars) sum.add_text(name);
  const auto& noise = setup.measurements.noise;
  const Eigen::VectorXd std = noise.standard_deviations();
  for (const double s : std) sum.add_number(s);
  sum.add_number(noise.log_determinant());
  return to_hex(sum.finish());
}

/// What stands behind the displacements, in words.
std::string scalars_last(const reduction::Sensors& sensors) {
  if (sensors.scalars.empty()) return "";
  return fmt::format(": {} displacements, then {}", sensors.displacement_count(),
                     fmt::join(sensors.scalars, ", "));
}

std::string units_of(const reduction::Sensors& sensors, std::size_t i) {
  return i < sensors.displacement_count() ? "values are in metres"
                                          : "of " + sensors.scalars[i - sensors.displacement_count()];
}

Identity identity_of(const project::Project& project, const project::UpdateSetup& setup) {
  return {sensors_hash(setup), to_hex(sha256_of_file(project.model)), to_hex(sha256_of(project.text)),
          project.text};
}

double seconds_since(MonotonicClock::time_point at) {
  return std::chrono::duration<double>(MonotonicClock::now() - at).count();
}

}  // namespace

Site::Site(project::Project project, bool strict_deadline, Metrics& metrics, std::function<void()> changed)
    : project_(std::move(project)),
      name_(project_.serve.site),
      strict_(strict_deadline),
      metrics_(metrics),
      changed_(std::move(changed)),
      setup_(project::set_up_online(project_)),
      sensor_std_(setup_.measurements.noise.standard_deviations()),
      identity_(identity_of(project_, setup_)),
      journal_(project_.serve.journal, Journal::Access::write),
      engine_(project::engine_setup(project_, setup_)) {
  if (journal_.identify(identity_))
    log_event(
        "warning",
        "the model or the project file is another than before: all data are assimilated with the new one",
        {{"site", name_}, {"journal", journal_.path()}});
  next_event_ = journal_.starts() * (std::int64_t{1} << 32) + 1;
  state_ = state_of_now();
}

Site::~Site() {
  stop();
}

void Site::start() {
  committer_ = std::thread([this] {
    replay();
    commit_loop();
  });
  updater_ = std::thread([this] { update_loop(); });
}

void Site::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  requests_there_.notify_all();
  if (committer_.joinable()) committer_.join();
  {
    const std::lock_guard lock(mutex_);
    no_more_arrivals_ = true;
  }
  arrivals_there_.notify_all();
  if (updater_.joinable()) updater_.join();
}

std::string Site::labels(const std::string& more) const {
  return fmt::format("site=\"{}\"{}{}", label_value(name_), more.empty() ? "" : ",", more);
}

void Site::count(const std::string& outcome) {
  {
    const std::lock_guard lock(mutex_);
    ++outcomes_[outcome];
  }
  metrics_.count("knothe_measurements_total", labels("outcome=\"" + outcome + "\""));
}

// --- Journal → posterior at the start --------------------------------------------------------------------

void Site::replay() {
  const auto start = MonotonicClock::now();
  std::vector<Arrival> past;
  std::vector<JournalEntry> held;
  journal_.for_each([&](const JournalEntry& entry) {
    const assimilation::DatumKey& key = entry.measurement.key;
    auto& largest = largest_seq_.try_emplace({key.source, key.session}, key.seq).first->second;
    largest = std::max(largest, key.seq);
    if (key.source == k_pictures_source || key.source == k_csv_source) from_folders_.insert(key);
    if (entry.quarantined && !entry.released) {
      held.push_back(entry);
    } else {
      past.push_back({entry.measurement, start, false});
    }
  });
  {
    const std::lock_guard lock(mutex_);
    std::move(past.begin(), past.end(), std::back_inserter(arrivals_));
    quarantine_ = std::move(held);
    records_ = journal_.count();
    replayed_ = true;
  }
  log_event("info", "journal opened",
            {{"site", name_},
             {"journal", journal_.path()},
             {"records", journal_.count()},
             {"elapsed_s", seconds_since(start)}});
  arrivals_there_.notify_all();
}

// --- Requests → journal ----------------------------------------------------------------------------------

void Site::check_values(const Measurement& datum) const {
  const Eigen::Index n = sensor_std_.size();
  if (static_cast<Eigen::Index>(datum.values.size()) != n)
    throw RequestError(400, "WrongSize",
                       fmt::format("\"values\" has {} entries; this site has {} sensors{}",
                                   datum.values.size(), n, scalars_last(setup_.measurements.sensors)));
  for (Eigen::Index i = 0; i < n; ++i) {
    const double value = datum.values[static_cast<std::size_t>(i)];
    if (std::abs(value) > k_largest_value * sensor_std_[i] || std::isinf(value))
      throw RequestError(
          400, "Malformed",
          fmt::format("values[{}] = {} is no measurement: its noise is {} ({})", i, value, sensor_std_[i],
                      units_of(setup_.measurements.sensors, static_cast<std::size_t>(i))));
  }
}

void Site::ingest(Measurement datum, std::function<void(Answer)> done) {
  check_values(datum);
  try {
    const double time = datum.time;
    datum.step = static_cast<std::int64_t>(
        assimilation::match_times({&time, 1}, setup_.observed->time, "the datum")[0]);
  } catch (const DataError& error) {
    throw RequestError(400, "UnknownTime", error.what());
  }
  const std::lock_guard lock(mutex_);
  if (!ready_ || stopping_ || requests_.size() >= k_longest_queue)
    throw RequestError(503, "NotReady",
                       stopping_ ? "the service is stopping"
                       : !ready_ ? "the journal is being replayed"
                                 : "too many measurements are waiting for the disk");
  requests_.push_back({std::move(datum), std::move(done), MonotonicClock::now()});
  requests_there_.notify_one();
}

void Site::release(assimilation::DatumKey key, std::function<void(Answer)> done) {
  const std::lock_guard lock(mutex_);
  if (!ready_ || stopping_) throw RequestError(503, "NotReady", "the service is not ready, or stopping");
  requests_.push_back({std::move(key), std::move(done), MonotonicClock::now()});
  requests_there_.notify_one();
}

void Site::commit_loop() {
  while (true) {
    std::vector<Request> group;
    {
      std::unique_lock lock(mutex_);
      const auto there = [&] { return !requests_.empty() || stopping_; };
      if (read_only_) {
        requests_there_.wait_for(lock, std::chrono::seconds(1), there);
      } else {
        requests_there_.wait(lock, there);
      }
      if (requests_.empty() && stopping_) return;
      while (!requests_.empty() && group.size() < k_largest_group) {
        group.push_back(std::move(requests_.front()));
        requests_.pop_front();
      }
    }
    if (group.empty()) {
      probe_disk();
    } else {
      commit(group);
    }
  }
}

/// One group of requests, one commit; each is answered when that is on disk.
void Site::commit(std::vector<Request>& group) {
  const auto start = MonotonicClock::now();
  std::vector<Answer> answers;
  std::vector<Arrival> arrivals;
  const auto largest_before = largest_seq_;
  std::string trouble;
  try {
    journal_.begin();
    for (Request& request : group) answers.push_back(write(request, arrivals));
    journal_.commit();
  } catch (const std::exception& error) {
    trouble = error.what();
    journal_.rollback();
    largest_seq_ = largest_before;
    arrivals.clear();
    answers.assign(group.size(),
                   RequestError(507, "DiskFull", fmt::format("nothing was stored: {}", trouble)));
  }
  metrics_.observe("knothe_phase_seconds", labels("phase=\"commit\""), seconds_since(start));
  {
    const std::lock_guard lock(mutex_);
    if (read_only_ != !trouble.empty()) {
      read_only_ = !trouble.empty();
      log_event(read_only_ ? "error" : "info",
                read_only_ ? "the journal cannot be written" : "the journal can be written again",
                {{"site", name_}, {"journal", journal_.path()}, {"reason", trouble}});
    }
    records_ = journal_.count();
    for (const Arrival& arrival : arrivals) {
      accepted_at_.push_back(arrival.at);
      if (accepted_at_.size() > 32) accepted_at_.pop_front();
    }
    std::move(arrivals.begin(), arrivals.end(), std::back_inserter(arrivals_));
  }
  arrivals_there_.notify_one();
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto* appended = std::get_if<Appended>(&answers[i]);
    count(appended == nullptr
              ? (std::get<RequestError>(answers[i]).status() == 507 ? "not_stored" : "conflicts")
          : appended->outcome == Outcome::duplicate ? "duplicates"
          : appended->quarantined                   ? "quarantined"
                                                    : "accepted");
    group[i].done(answers[i]);
  }
  changed_();
}

Site::Answer Site::write(Request& request, std::vector<Arrival>& arrivals) {
  if (const auto* key = std::get_if<assimilation::DatumKey>(&request.what)) {
    const auto entry = journal_.release(*key);
    if (!entry)
      return RequestError(
          404, "NotQuarantined",
          fmt::format("there is no quarantined datum of source \"{}\", session \"{}\", seq {}", key->source,
                      key->session, key->seq));
    if (!entry->released) arrivals.push_back({entry->measurement, request.at, true});
    const std::lock_guard lock(mutex_);
    std::erase_if(quarantine_, [&](const JournalEntry& held) { return held.id == entry->id; });
    return Appended{entry->released ? Outcome::duplicate : Outcome::accepted, false, entry->measurement.step,
                    entry->measurement.received_ms};
  }
  Measurement& datum = std::get<Measurement>(request.what);
  const auto [largest, is_new] =
      largest_seq_.try_emplace({datum.key.source, datum.key.session}, datum.key.seq);
  const bool late = !is_new && largest->second - datum.key.seq > project_.serve.window;
  const Appended appended = journal_.append(datum, late);
  if (appended.outcome == Outcome::conflict)
    return RequestError(
        409, "Conflict",
        fmt::format("source \"{}\", session \"{}\", seq {} is there already with another payload; it stays",
                    datum.key.source, datum.key.session, datum.key.seq));
  if (appended.outcome == Outcome::duplicate) return appended;
  largest->second = std::max(largest->second, datum.key.seq);
  if (datum.key.source == k_pictures_source || datum.key.source == k_csv_source) {
    const std::lock_guard lock(mutex_);
    from_folders_.insert(datum.key);
  }
  datum.received_ms = appended.received_ms;
  if (!late) {
    arrivals.push_back({datum, request.at, true});
    return appended;
  }
  const std::lock_guard lock(mutex_);
  quarantine_.push_back({journal_.count(), datum, true, false});
  return appended;
}

/// Whether the disk takes writes again: the journal's own page, so that it is the same disk and the same
/// room.
void Site::probe_disk() {
  try {
    journal_.begin();
    journal_.touch();
    journal_.commit();
  } catch (const std::exception&) {
    journal_.rollback();
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    read_only_ = false;
  }
  log_event("info", "the journal can be written again", {{"site", name_}, {"journal", journal_.path()}});
  changed_();
}

}  // namespace knothe::service
