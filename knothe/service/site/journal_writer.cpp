#include "knothe/service/site/journal_writer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <future>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/likelihood/data/time_matching.hpp"
#include "knothe/project/update_setup.hpp"
#include "knothe/service/journal/sqlite.hpp"
#include "knothe/service/journal/step_matching.hpp"

namespace knothe::service {
namespace {

constexpr double k_max_commit = 60;           // s, of one group
constexpr std::chrono::seconds k_idle{1};     // then the journal is looked after
constexpr std::size_t k_largest_group = 256;  // measurements in one commit
constexpr std::size_t k_replayed_at_once = 4096;
constexpr std::size_t k_longest_queue = 4096;  // then 503: memory is finite
constexpr double k_largest_value = 1e60;       // in standard deviations: its square must not overflow

constexpr std::uintmax_t k_large_log = 64 << 20;  // bytes; SQLite keeps it at 4 MB where it can

std::uintmax_t log_size(const std::string& journal) {
  std::error_code none;
  const std::uintmax_t size = std::filesystem::file_size(journal + "-wal", none);
  return none ? 0 : size;
}

/// SQLite moves its log into the journal unless another program holds a reading transaction open.
void tell_of_large_log(const std::string& site, const std::string& journal, std::uintmax_t before) {
  const std::uintmax_t now = log_size(journal);
  if (now / k_large_log > before / k_large_log)
    log_event("warning", "the journal's log grows: another program reads the journal, and does not end",
              {{"site", site}, {"journal", journal}, {"log_mb", now >> 20}});
}

/// What stands behind the displacements, in words.
std::string scalars_last(const model::Sensors& sensors) {
  if (sensors.scalars.empty()) return "";
  return fmt::format(": {} displacements, then {}", sensors.displacement_count(),
                     fmt::join(sensors.scalars, ", "));
}

/// As the engine sees them.
bool same_values(const Measurement& a, const Measurement& b) {
  const std::vector<double> left = a.effective_values(), right = b.effective_values();
  return std::equal(left.begin(), left.end(), right.begin(), right.end(),
                    [](double x, double y) { return x == y || (std::isnan(x) && std::isnan(y)); });
}

std::string units_of(const model::Sensors& sensors, std::size_t i) {
  return i < sensors.displacement_count() ? "values are in metres"
                                          : "of " + sensors.scalars[i - sensors.displacement_count()];
}

}  // namespace

Json answer_of(const Appended& appended) {
  Json body = {{"accepted", true},
               {"duplicate", appended.outcome == AppendOutcome::duplicate},
               {"step", appended.step},
               {"record", appended.record}};
  if (appended.quarantined) {
    body["quarantined"] = true;
    body["reason"] = appended.reason;
  }
  if (appended.replacement) body["replacement"] = true;
  return body;
}

Json answer_of(const Withdrawn& withdrawn) {
  return {{"withdrawn", true}, {"step", withdrawn.step}};
}

JournalWriter::JournalWriter(const project::Project& project, const project::UpdateSetup& setup,
                             Metrics& metrics, Listener listener)
    : options_(project.serve),
      setup_(setup),
      sensor_std_(setup.measurements.noise.measurement().standard_deviations()),
      limits_(project::serve_limits(project, setup)),
      metrics_(metrics),
      listener_(std::move(listener)),
      journal_(options_.journal),
      id_(journal_.id()),
      switches_(setup.problem.model->time) {
  for (const LogbookEntry& entry : journal_.logbook()) apply(entry);
}

void JournalWriter::apply(const LogbookEntry& entry) {
  switches_.add(entry);
  course_.add(entry);
}

/// Data of all times are there in the model: an index of a step is that of the model it was recorded with.
void JournalWriter::require_times() const {
  journal_.for_each([&](JournalEntry entry) {
    if (!entry.withdrawn) match_step(entry, setup_.problem.model->time, journal_.path());
  });
}

void JournalWriter::identify(const Identity& identity) {
  const auto before = journal_.identity();
  if (!before || before->sensors == identity.sensors) require_times();
  if (journal_.identify(identity))
    log_event("warning",
              "the model or the project file has changed: all data are assimilated with the new one",
              {{"site", options_.site}, {"journal", journal_.path()}});
}

std::int64_t JournalWriter::count_start(std::int64_t least) {
  journal_.raise_starts(least);
  return journal_.starts();
}

void JournalWriter::start(std::shared_ptr<Pulse> pulse) {
  pulse_ = pulse ? std::move(pulse) : std::make_shared<Pulse>("the journal's thread", k_max_commit);
  thread_ = std::thread([this] {
    replay();
    commit_loop();
  });
}

void JournalWriter::open() {
  const std::lock_guard lock(mutex_);
  open_ = true;
}

void JournalWriter::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  requests_there_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void JournalWriter::finish() {
  try {
    write_aside();
    if (journal_.in_place()) (void)journal_.checkpoint();
  } catch (const std::exception& error) {
    log_event("error", "the journal could not be closed in order",
              {{"site", options_.site}, {"journal", journal_.path()}, {"reason", error.what()}});
  }
}

void JournalWriter::store_alarm(Alarm alarm) {
  {
    const std::lock_guard lock(mutex_);
    alarms_.push_back(std::move(alarm));
  }
  requests_there_.notify_one();
}

void JournalWriter::note(JournalFile file) {
  files_.note(std::move(file));
  requests_there_.notify_one();
}

bool JournalWriter::ready() const {
  const std::lock_guard lock(mutex_);
  return open_ && !stopping_;
}

void JournalWriter::count(const std::string& outcome) {
  {
    const std::lock_guard lock(mutex_);
    ++outcomes_[outcome];
  }
  metrics_.count("knothe_measurements_total", site_labels(options_.site, "outcome=\"" + outcome + "\""));
}

std::optional<Measurement> JournalWriter::last_frame() const {
  const std::lock_guard lock(mutex_);
  return last_frame_;
}

JournalWriter::Tally JournalWriter::tally() const {
  const std::lock_guard lock(mutex_);
  return {requests_.size(), quarantine_.size(), outcomes_, !trouble_.empty(), trouble_};
}

Json JournalWriter::quarantine() const {
  const std::lock_guard lock(mutex_);
  Json list = Json::array();
  for (const JournalEntry& entry : quarantine_) {
    const Measurement& d = entry.measurement;
    list.push_back({{"source", d.key.source},
                    {"session", d.key.session},
                    {"seq", d.key.seq},
                    {"time", d.time},
                    {"step", d.step},
                    {"reason", reason_of(entry.quarantined, d)}});
  }
  return {{"quarantined", list}};
}

void JournalWriter::replay() {
  const auto start = monotonic_now();
  std::vector<Arrival> past;
  std::vector<JournalEntry> held;
  std::set<likelihood::DatumKey> from_folders;
  std::optional<Measurement> last_frame;
  journal_.for_each([&](JournalEntry entry) {
    pulse_->beat();
    if (past.size() >= k_replayed_at_once)
      listener_.arrived(std::exchange(past, {}), journal_.count(), false);
    const likelihood::DatumKey& key = entry.measurement.key;
    if (key.source == k_camera_source && (!last_frame || last_frame->time < entry.measurement.time)) {
      last_frame.emplace().key = key;
      last_frame->time = entry.measurement.time, last_frame->received_ms = entry.measurement.received_ms;
    }
    // Of a withdrawn datum too: its file is still there, and would bring it back.
    if (key.source == k_pictures_source || key.source == k_csv_source) from_folders.insert(key);
    if (entry.withdrawn) {
      // Readers may still have the line that it once gave, if it was one of this model.
      const auto step = likelihood::matching_time(entry.measurement.time, setup_.problem.model->time);
      if (!step) return;
      entry.measurement.step = *step;
      past.push_back({entry.measurement, start, Arrival::Kind::withdrawn});
      return;
    }
    match_step(entry, setup_.problem.model->time, journal_.path());
    entry.measurement = switches_.seen(std::move(entry.measurement));
    count_seq(key);
    if (entry.counts()) {
      past.push_back({entry.measurement, start, Arrival::Kind::past});
    } else {
      held.push_back(entry);
    }
  });
  // Whoever was told before the restart may be gone; the datum is still there.
  for (const JournalEntry& entry : held)
    if (entry.quarantined.implausible)
      listener_.doubted(entry.measurement, reason_of({false, true}, entry.measurement));
  {
    const std::lock_guard lock(mutex_);
    quarantine_ = std::move(held);
    last_frame_ = std::move(last_frame);
  }
  files_.restore(journal_.files(), std::move(from_folders));
  log_event("info", "journal opened",
            {{"site", options_.site},
             {"journal", journal_.path()},
             {"records", journal_.count()},
             {"elapsed_s", seconds_since(start)}});
  listener_.arrived(std::move(past), journal_.count(), true);
}

void JournalWriter::check_values(const Measurement& datum) const {
  const Eigen::Index n = sensor_std_.size();
  if (std::ssize(datum.values) != n)
    throw RequestError(400, "WrongSize",
                       fmt::format("\"values\" has {} entries; this site has {} sensors{}",
                                   datum.values.size(), n, scalars_last(setup_.measurements.sensors)));
  for (Eigen::Index i = 0; i < n; ++i) {
    const double value = datum.values[i];
    if (std::abs(value) > k_largest_value * sensor_std_[i] || std::isinf(value))
      throw RequestError(400, "Malformed",
                         fmt::format("values[{}] = {} is no measurement: its noise is {} ({})", i, value,
                                     sensor_std_[i], units_of(setup_.measurements.sensors, i)));
  }
}

/// What is beyond its limit in a datum, in words; empty: nothing.
std::string JournalWriter::complaint(const Measurement& datum) const {
  const std::vector<double> values = datum.effective_values();
  // A journal may be of another time: what cannot be these sensors' is not judged by their limits.
  if (std::ssize(values) != sensor_std_.size()) return "";
  return limits_.complaint(Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values)));
}

/// In words. The journal says why it was; the limits, that may be others by now, say which value.
std::string JournalWriter::reason_of(Quarantine quarantined, const Measurement& datum) const {
  std::string reason;
  if (quarantined.implausible) {
    reason = complaint(datum);
    if (reason.empty()) reason = "a value was beyond the limit of that time";
  }
  if (quarantined.late) reason += reason.empty() ? "it came too late" : "; it came too late";
  return reason;
}

void JournalWriter::ingest(Measurement datum, std::function<void(Answer)> done,
                           std::optional<JournalFile> file) {
  if (!datum.series.empty()) datum.set_values_of_series(setup_.measurements.sensors);
  check_values(datum);
  try {
    datum.step = likelihood::match_times({&datum.time, 1}, setup_.problem.model->time, "the datum")[0];
  } catch (const DataError& error) {
    throw RequestError(400, "UnknownTime", error.what());
  }
  enqueue({std::move(datum), std::move(done), monotonic_now(), std::move(file)});
}

void JournalWriter::release(RecordName name, Signature signature, std::function<void(Answer)> done) {
  enqueue({Release{std::move(name), std::move(signature)}, std::move(done), monotonic_now()});
}

void JournalWriter::withdraw(RecordName name, Signature signature, std::function<void(Answer)> done) {
  enqueue({Withdrawal{std::move(name), std::move(signature)}, std::move(done), monotonic_now()});
}

void JournalWriter::enter(LogbookEntry entry, std::function<void(Answer)> done) {
  enqueue({std::move(entry), std::move(done), monotonic_now()});
}

LogbookEntry JournalWriter::enter(LogbookEntry entry) {
  const auto promise = std::make_shared<std::promise<Answer>>();
  auto answer = promise->get_future();
  enter(std::move(entry), [promise](const Answer& written) { promise->set_value(written); });
  const Answer written = answer.get();
  if (const auto* error = std::get_if<RequestError>(&written)) throw RequestError(*error);
  return std::get<LogbookEntry>(written);
}

void JournalWriter::enqueue(Request request) {
  const std::lock_guard lock(mutex_);
  if (!open_ || stopping_ || requests_.size() >= k_longest_queue)
    throw RequestError(503, "NotReady",
                       stopping_ ? "the service is stopping"
                       : !open_  ? "the journal is being replayed"
                                 : "too many measurements are waiting for the disk");
  requests_.push_back(std::move(request));
  requests_there_.notify_one();
}

void JournalWriter::commit_loop() {
  while (true) {
    std::vector<Request> group;
    {
      pulse_->rest();
      std::unique_lock lock(mutex_);
      requests_there_.wait_for(lock, k_idle, [&] { return !requests_.empty() || stopping_ || has_aside(); });
      if (requests_.empty() && alarms_.empty() && stopping_) return;
      if (requests_.empty() && stopping_ && !trouble_.empty()) return;
      while (!requests_.empty() && group.size() < k_largest_group) {
        group.push_back(std::move(requests_.front()));
        requests_.pop_front();
      }
    }
    pulse_->beat();
    bool aside = false;
    {
      const std::lock_guard lock(mutex_);
      aside = has_aside();
    }
    if (group.empty() && !aside) {
      look_after_journal();
    } else {
      commit(group);
    }
  }
}

/// What goes by itself where no request takes it along.
bool JournalWriter::has_aside() const {
  return (!alarms_.empty() || files_.has_unwritten()) && trouble_.empty();
}

/// When nothing comes: is the journal still there, can it be written, is it all in its own file?
void JournalWriter::look_after_journal() {
  const bool refused = tally().read_only;
  if (refused || !journal_.in_place()) return probe_disk();
  if (checkpointed_) return;
  try {
    checkpointed_ = journal_.checkpoint();
  } catch (const std::exception& error) {
    set_trouble(error.what());
  }
}

/// What keeps the journal from being written from now on; empty: nothing.
void JournalWriter::set_trouble(const std::string& trouble) {
  const std::lock_guard lock(mutex_);
  if (trouble.empty() != trouble_.empty())
    log_event(trouble.empty() ? "info" : "error",
              trouble.empty() ? "the journal can be written again" : "the journal cannot be written",
              {{"site", options_.site}, {"journal", journal_.path()}, {"reason", trouble}});
  trouble_ = trouble;
}

/// Alarms and files, by themselves. What cannot be kept is said.
void JournalWriter::write_aside() {
  if (alarms_.empty() && !files_.has_unwritten()) return;
  try {
    journal_.begin();
    for (const JournalFile& file : files_.take_unwritten()) journal_.add_file(file);
    for (const Alarm& alarm : std::exchange(alarms_, {})) journal_.add_alarm(alarm);
    journal_.commit();
  } catch (const std::exception& error) {
    journal_.rollback();
    log_event("error", "alarms could not be kept", {{"site", options_.site}, {"reason", error.what()}});
  }
}

/// A journal that was moved while it was written has the data, and they are assimilated; but who does not put
/// it back loses them, so nobody is told that they are stored. Why, in words; empty: it is in its place.
std::string JournalWriter::refuse_if_misplaced(std::vector<Answer>& answers) const {
  try {
    journal_.require_in_place();
    return "";
  } catch (const DiskFullError& error) {
    answers.assign(answers.size(), RequestError(507, "DiskFull", error.what()));
    return error.what();
  }
}

/// One group of requests, one commit; each is answered when that is on disk.
void JournalWriter::commit(std::vector<Request>& group) {
  const auto start = monotonic_now();
  const std::uintmax_t log_before = log_size(journal_.path());
  std::vector<Answer> answers;
  Written written;
  largest_before_.clear();
  const SensorSwitches switches_before = switches_;
  const TestCourse course_before = course_;
  std::string trouble;
  const std::deque<JournalFile> files = files_.take_unwritten();  // before the alarms: see `note`
  std::deque<Alarm> alarms;
  {
    const std::lock_guard lock(mutex_);
    alarms.swap(alarms_);
  }
  try {
    journal_.begin();
    for (Request& request : group) answers.push_back(write(request, written));
    for (const Alarm& alarm : alarms) journal_.add_alarm(alarm);
    for (const JournalFile& file : files) journal_.add_file(file);
    journal_.commit();
    checkpointed_ = false;
  } catch (const std::exception& error) {
    trouble = error.what();
    journal_.rollback();
    for (auto& [session, seqs] : largest_before_) largest_seqs_[session] = std::move(seqs);
    switches_ = switches_before;
    course_ = course_before;
    written = {};
    answers.assign(group.size(),
                   RequestError(507, "DiskFull", fmt::format("nothing was stored: {}", trouble)));
  }
  if (trouble.empty()) {
    tell_of_large_log(options_.site, journal_.path(), log_before);
    trouble = refuse_if_misplaced(answers);
  } else {
    files_.put_back(files);
    const std::lock_guard lock(mutex_);
    alarms_.insert(alarms_.begin(), alarms.begin(), alarms.end());
  }
  metrics_.observe("knothe_phase_seconds", site_labels(options_.site, "phase=\"commit\""),
                   seconds_since(start));
  for (const likelihood::DatumKey& key : written.from_folders) files_.hold(key);
  for (const JournalFile& file : written.files) files_.hold(file);
  {
    const std::lock_guard lock(mutex_);
    quarantine_.insert(quarantine_.end(), written.quarantined.begin(), written.quarantined.end());
    for (const JournalEntry& gone : written.no_longer_quarantined)
      std::erase_if(quarantine_, [&](const JournalEntry& held) { return held.id == gone.id; });
  }
  set_trouble(trouble);
  announce(written);
  listener_.arrived(std::move(written.arrivals), journal_.count(), true);
  for (std::size_t i = 0; i < group.size(); ++i) {
    count_outcome(answers[i]);
    group[i].done(answers[i]);
  }
  listener_.changed();
}

/// What is on disk now, beside the data that are to be assimilated.
void JournalWriter::announce(const Written& written) {
  for (const JournalEntry& entry : written.no_longer_quarantined) listener_.doubted(entry.measurement, "");
  for (const JournalEntry& entry : written.quarantined)
    if (entry.quarantined.implausible)
      listener_.doubted(entry.measurement, reason_of({false, true}, entry.measurement));
  for (const Measurement& datum : written.withdrawn)
    log_event("info", "a datum was withdrawn",
              {{"site", options_.site},
               {"source", datum.key.source},
               {"session", datum.key.session},
               {"seq", datum.key.seq},
               {"step", datum.step}});
  for (const LogbookEntry& entry : written.entries) {
    log_event("info", "an entry was written into the logbook",
              {{"site", options_.site}, {"entry", json_of(entry)}});
    listener_.noted(entry);
  }
}

void JournalWriter::count_outcome(const Answer& answer) {
  if (const auto* error = std::get_if<RequestError>(&answer)) {
    if (error->status() == 507) count("not_stored");
    if (error->status() == 409) count(error->type() == "TestFinished" ? "after_finish" : "conflicts");
  } else if (const auto* withdrawn = std::get_if<Withdrawn>(&answer)) {
    if (!withdrawn->before) count("withdrawn");
  } else if (std::holds_alternative<Appended>(answer)) {
    const Appended& appended = std::get<Appended>(answer);
    count(appended.outcome == AppendOutcome::duplicate ? "duplicates"
          : appended.quarantined                       ? "quarantined"
                                                       : "accepted");
  }
}

JournalWriter::Answer JournalWriter::write(Request& request, Written& written) {
  Answer answer = std::visit([&](auto& what) { return write(what, request.at, written); }, request.what);
  if (request.file && std::holds_alternative<Appended>(answer)) {
    journal_.add_file(*request.file);
    written.files.push_back(std::move(*request.file));
  }
  return answer;
}

/// Who did it, if somebody says, in the commit of what was done.
void JournalWriter::sign(EntryKind kind, const JournalEntry& entry, const Signature& signature,
                         Written& written) {
  if (signature.author.empty()) return;
  const auto& [source, session, seq] = entry.measurement.key;
  const bool held = entry.quarantined && !entry.released;
  const std::string text =
      fmt::format("{}, {}, {} {}{}{}{}", source, session, seq, to_text(kind), held ? " from quarantine" : "",
                  signature.text.empty() ? "" : ": ", signature.text);
  written.entries.push_back(
      journal_.add_entry({0, kind, entry.id, entry.measurement.time, signature.author, text, 0}));
}

JournalWriter::Answer JournalWriter::write(const Release& release, MonotonicTime at, Written& written) {
  auto entry = journal_.release(release.name);
  if (!entry)
    return RequestError(404, "NotQuarantined",
                        fmt::format("there is no quarantined datum of source \"{}\", session \"{}\", seq {}",
                                    release.name.key.source, release.name.key.session, release.name.key.seq));
  match_step(*entry, setup_.problem.model->time, journal_.path());
  if (!entry->released) {
    written.arrivals.push_back({switches_.seen(entry->measurement), at});
    sign(EntryKind::released, *entry, release.signature, written);
  }
  written.no_longer_quarantined.push_back(*entry);
  return Appended{entry->released ? AppendOutcome::duplicate : AppendOutcome::accepted,
                  {},
                  entry->measurement.step,
                  entry->id,
                  entry->measurement.received_ms,
                  false,
                  {}};
}

JournalWriter::Answer JournalWriter::write(const Withdrawal& withdrawal, MonotonicTime at, Written& written) {
  const likelihood::DatumKey& key = withdrawal.name.key;
  auto entry = journal_.withdraw(withdrawal.name);
  if (!entry)
    return RequestError(404, "UnknownDatum",
                        fmt::format("there is no datum of source \"{}\", session \"{}\", seq {}{}",
                                    key.source, key.session, key.seq,
                                    withdrawal.name.which == RecordName::Which::numbered
                                        ? fmt::format(" with the record number {}", withdrawal.name.number)
                                        : ""));
  if (const auto step = likelihood::matching_time(entry->measurement.time, setup_.problem.model->time))
    entry->measurement.step = *step;
  if (!entry->withdrawn) {
    if (entry->counts()) written.arrivals.push_back({entry->measurement, at, Arrival::Kind::withdrawn});
    written.no_longer_quarantined.push_back(*entry);
    written.withdrawn.push_back(entry->measurement);
    sign(EntryKind::withdrawn, *entry, withdrawal.signature, written);
    // What comes now is judged late by the data that are left: a wrong seq, far ahead, is no more in the way.
    seqs_of(key) = journal_.largest_seqs(key.source, key.session, options_.window + 1);
  }
  return Withdrawn{entry->measurement.step, entry->withdrawn, !journal_.withdrawn(key).value_or(true)};
}

/// A switch changes what the data from its time on say: those are assimilated again.
JournalWriter::Answer JournalWriter::write(const LogbookEntry& entry, MonotonicTime at, Written& written) {
  const bool finishes = entry.kind == EntryKind::test_finished;
  if ((finishes || entry.kind == EntryKind::test_resumed) && finishes == course_.end().has_value())
    return RequestError(409, "TestFinished",
                        finishes ? "the test is finished already" : "the test is not finished");
  LogbookEntry kept = journal_.add_entry(entry);
  const SensorSwitches before = switches_;
  apply(kept);
  written.entries.push_back(kept);
  if (kept.kind != EntryKind::sensor_off && kept.kind != EntryKind::sensor_on) return kept;
  const std::size_t from = switches_.first_step(kept.time);
  journal_.for_each([&](JournalEntry record) {
    if (!record.counts()) return;
    match_step(record, setup_.problem.model->time, journal_.path());
    if (static_cast<std::size_t>(record.measurement.step) < from) return;
    Measurement seen = switches_.seen(record.measurement);
    if (!same_values(seen, before.seen(record.measurement)))
      written.arrivals.push_back({std::move(seen), at, Arrival::Kind::replaced});
  });
  return kept;
}

/// Why a test that was finished takes no new datum.
RequestError JournalWriter::refusal_after(const LogbookEntry& end) {
  if (end.kind == EntryKind::test_followed)
    return {503, "NotReady",
            fmt::format("the test \"{}\" is taking the place of this one: send it again", end.text)};
  return {409, "TestFinished",
          fmt::format("the test was finished by {}: no more data are taken. Resume it (POST "
                      "/v1/tests/resume), or begin the next one (POST /v1/tests)",
                      end.author)};
}

/// To be changed by the group at hand, and remembered as they were.
std::vector<std::int64_t>& JournalWriter::seqs_of(const likelihood::DatumKey& key) {
  auto& seqs = largest_seqs_[{key.source, key.session}];
  largest_before_.try_emplace({key.source, key.session}, seqs);
  return seqs;
}

/// The places that a datum is late are the data of its session that should have come after it and came
/// before: one wrong seq, however far ahead, is one of them.
void JournalWriter::count_seq(const likelihood::DatumKey& key) {
  auto& largest = seqs_of(key);
  largest.insert(std::upper_bound(largest.begin(), largest.end(), key.seq, std::greater<>()), key.seq);
  if (std::ssize(largest) > options_.window + 1) largest.pop_back();
}

JournalWriter::Answer JournalWriter::write(Measurement& datum, MonotonicTime at, Written& written) {
  const auto withdrawn = journal_.withdrawn(datum.key);
  if (course_.end() && withdrawn.value_or(true)) return refusal_after(*course_.end());
  using Restores = Measurement::Restores;
  const bool repeats = datum.restores == Restores::never ||
                       (datum.restores == Restores::if_changed && journal_.has_withdrawn(datum));
  if (withdrawn.value_or(false) && repeats)
    return RequestError(
        409, "Withdrawn",
        fmt::format("source \"{}\", session \"{}\", seq {} was withdrawn, and what comes again by "
                    "itself does not restore it: send it under another key",
                    datum.key.source, datum.key.session, datum.key.seq));
  const auto& largest = largest_seqs_[{datum.key.source, datum.key.session}];
  const bool late = std::ssize(largest) > options_.window && largest.back() > datum.key.seq;
  Measurement seen = switches_.seen(datum);
  Appended appended = journal_.append(datum, {late, !complaint(seen).empty()});
  appended.reason = reason_of(appended.quarantined, seen);
  if (appended.outcome == AppendOutcome::conflict)
    return RequestError(
        409, "Conflict",
        fmt::format("source \"{}\", session \"{}\", seq {} is there already with another payload; it stays",
                    datum.key.source, datum.key.session, datum.key.seq));
  appended.step = datum.step;  // of a duplicate too: the journal's index is of the model of its time
  if (appended.outcome == AppendOutcome::duplicate) return appended;
  count_seq(datum.key);
  if (datum.key.source == k_pictures_source || datum.key.source == k_csv_source)
    written.from_folders.push_back(datum.key);
  seen.received_ms = appended.received_ms;
  if (appended.quarantined) {
    written.quarantined.push_back({journal_.count(), std::move(seen), appended.quarantined, false, false});
  } else {
    written.arrivals.push_back({std::move(seen), at});
  }
  return appended;
}

/// Whether the disk takes writes again: the journal's own page, so that it is the same disk and the same
/// room.
void JournalWriter::probe_disk() {
  try {
    journal_.begin();
    journal_.touch();
    journal_.commit();
    set_trouble("");
  } catch (const std::exception& error) {
    journal_.rollback();
    set_trouble(error.what());
  }
  listener_.changed();
}

}  // namespace knothe::service
