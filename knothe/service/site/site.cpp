#include "knothe/service/site/site.hpp"

#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/record/step_record.hpp"
#include "knothe/service/journal/test_journals.hpp"

namespace knothe::service {
namespace {

constexpr std::size_t k_newest_first_from = 16;  // stale lines
// s; a thread that is longer at one piece of work is stuck
constexpr double k_max_commit = 60, k_max_update = 600;
constexpr double k_moved_std = 0.5;  // of a posterior that is asked about again

std::string folder_of(const std::string& journal) {
  const auto folder = std::filesystem::path(journal).parent_path();
  return folder.empty() ? "." : folder.string();
}

/// Of "a/b" and "c", and of "a" and "b/c", one string each.
std::string escaped(const std::string& name) {
  std::string text;
  for (const char c : name) text += c == '/' ? "%2F" : c == '%' ? "%25" : std::string(1, c);
  return text;
}

}  // namespace

Site::Site(project::Project project, SiteSettings settings, Metrics& metrics)
    : SiteFacts(std::move(project), settings.test),
      settings_(std::move(settings)),
      metrics_(metrics),
      journal_(
          project_, setup_, metrics_,
          {[this](std::vector<Arrival> arrivals, std::int64_t records, bool all_replayed) {
             arrive(std::move(arrivals), records, all_replayed);
           },
           [this](const Measurement& measurement, const std::string& reason) { doubt(measurement, reason); },
           [this](const LogbookEntry& entry) { note_down(entry); }, settings_.changed}),
      logbook_(setup_.problem.model->time, {}),
      alarms_(project_.forecasts, next_event_,
              [this](const Alarm& alarm) {
                journal_.store_alarm(alarm);
                if (!alarm.severity.empty()) settings_.send(alarm);
              }),
      pictures_(setup_.problem.model->time),
      lines_(folder_of(project_.serve.journal)),
      health_(project_.serve, settings_.strict_deadline) {
  journal_.identify(identity_);
  starts_ = journal_.count_start(settings_.min_start);
  next_event_ = starts_ * (std::int64_t{1} << 32) + 1;
  const JournalReader& records = journal_.records();
  alarms_.restore(records.alarms(8 * SiteAlarms::k_kept), records.conditions());
  for (const LogbookEntry& entry : records.logbook()) note_down(entry);
  restore_model();
  metrics_.count("knothe_deadline_misses_total", labels(), 0);  // there from the first scrape on
  if (records.lost().empty()) return;
  log_event("error", "records of the journal are lost", {{"site", name()}, {"reason", records.lost()}});
  alarms_.raise(0, "alarm", "journal", records.lost());
}

Site::~Site() {
  stop();
}

/// The model of the journal, and who asks the full-order one.
void Site::restore_model() {
  const std::vector<LogbookEntry> entries = logbook_.after(0);
  const Verification own = last_verification({}, identity_.model);
  try {
    model_ = std::make_shared<const ServedModel>(
        served_model(project_, setup_, project_.serve.journal, last_verification(entries, identity_.model)));
  } catch (const DataError& error) {
    const std::string trouble = fmt::format("{}; the project's own model is used", error.what());
    log_event("error", "a refined model is lost", {{"site", name()}, {"reason", trouble}});
    alarms_.raise(0, "alarm", "journal", trouble);
    model_ = std::make_shared<const ServedModel>(ServedModel{project_, setup_, own});
  }
  engine_ = std::make_unique<assimilation::Engine>(model_->engine_setup());
  verification_ = model_->verification;
  priors_ = engine_->priors();
  centre_ = engine_->centre();
  if (project_.method.verify == project::ModelVerification::off) return;
  verification_wanted_ = awaits_verification(entries);
  Verifier::Listener listener;
  listener.store = [this](const Verification& verification) { return store_verification(verification); };
  listener.wake = [this] {
    { const std::lock_guard lock(mutex_); }
    arrivals_there_.notify_one();
  };
  verifier_ = std::make_unique<Verifier>(project_, project_.serve.journal, std::move(listener));
}

void Site::start() {
  journal_.start(health_.pulses().add("the journal's thread", k_max_commit));
  pulse_ = health_.pulses().add("the updating thread", k_max_update);
  updater_ = std::thread([this] { update_loop(); });
}

void Site::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  arrivals_taken_.notify_all();
  if (verifier_) verifier_->stop();
  journal_.stop();
  {
    const std::lock_guard lock(mutex_);
    no_more_arrivals_ = true;
  }
  arrivals_there_.notify_all();
  if (updater_.joinable()) updater_.join();
  journal_.finish();
}

bool Site::settled() const {
  const std::lock_guard lock(mutex_);
  return journal_.tally().waiting == 0 && arrivals_.empty() && at_hand_ == 0 && stale_lines_ == 0;
}

Site::Form Site::form_up_to(std::size_t step) {
  const std::lock_guard lock(engine_mutex_);
  return {model_, engine_->form_up_to(step)};
}

std::shared_ptr<const ServedModel> Site::model() const {
  const std::lock_guard lock(engine_mutex_);
  return model_;
}

// --- Journal → lines -------------------------------------------------------------------------------------

/// From the journal's thread. Waits while many of the journal's past are to be added: memory is finite.
void Site::arrive(std::vector<Arrival> arrivals, std::int64_t records, bool all_replayed) {
  {
    std::unique_lock lock(mutex_);
    arrivals_taken_.wait(lock, [&] { return replayed_ || stopping_ || arrivals_.empty(); });
    for (Arrival& arrival : arrivals) {
      if (arrival.kind == Arrival::Kind::live) health_.accept(arrival.at);
      arrivals_.push_back(std::move(arrival));
    }
    records_ = records;
    replayed_ = replayed_ || all_replayed;
  }
  arrivals_there_.notify_one();
}

/// The same. It is not assimilated, so nothing else would tell of it.
void Site::doubt(const Measurement& measurement, const std::string& reason) {
  const bool is_held = !reason.empty();
  if (is_held)
    log_event("warning", "a datum is in quarantine",
              {{"site", name()},
               {"source", measurement.key.source},
               {"session", measurement.key.session},
               {"seq", measurement.key.seq},
               {"step", measurement.step},
               {"reason", reason}});
  const std::size_t step = std::max<std::int64_t>(measurement.step, 0);
  const auto& key = measurement.key;
  alarms_.update_condition(fmt::format("held {}/{}/{}", escaped(key.source), escaped(key.session), key.seq),
                           step, is_held ? "alarm" : "", "sensors", fmt::format("in quarantine: {}", reason));
}

/// The same, and at the start.
void Site::note_down(const LogbookEntry& entry) {
  logbook_.add(entry);
  if (entry.kind == EntryKind::acknowledgement)
    alarms_.acknowledge(entry.subject, {entry.author, entry.text, entry.written_ms, 0});
  if (!verifier_) return;  // there is none yet at the start
  {
    const std::lock_guard lock(mutex_);
    const bool asks = entry.kind == EntryKind::test_finished || entry.kind == EntryKind::verification_asked;
    verification_wanted_ = asks || (verification_wanted_ && entry.kind != EntryKind::test_resumed);
  }
  arrivals_there_.notify_one();
}

void Site::update_loop() {
  while (true) {
    std::vector<Arrival> arrivals;
    bool finish = false;
    {
      pulse_->rest();
      std::unique_lock lock(mutex_);
      arrivals_there_.wait(lock, [&] {
        return !arrivals_.empty() || no_more_arrivals_ || (replayed_ && (!ready_ || stale_lines_ > 0)) ||
               has_verification_to_do();
      });
      // Stopping: what is accepted is in the journal, and the next start computes it.
      if (no_more_arrivals_) return;
      arrivals.assign(std::make_move_iterator(arrivals_.begin()), std::make_move_iterator(arrivals_.end()));
      arrivals_.clear();
      at_hand_ = arrivals.size();
      finish = replayed_;
    }
    arrivals_taken_.notify_all();
    pulse_->beat();
    apply_arrivals(arrivals);
    pulse_->beat();
    if (!finish) continue;  // the newest step is still to come
    if (!arrivals.empty()) newest_is_shown_ = false;
    conclude_next();
    adopt_verification();
    ask_full_order_model();
    const auto& stale = engine_->stale();
    {
      const std::lock_guard lock(mutex_);
      stale_lines_ = stale.size();
      if (finish && !ready_) {
        ::malloc_trim(0);  // what reading model and journal took and gave back to nobody
        ready_ = true;
        log_event("info", "ready",
                  {{"site", name()}, {"records", records_}, {"elapsed_s", seconds_since(started_)}});
        journal_.open();
      }
    }
    check_delays();
    settings_.changed();
  }
}

void Site::apply_arrivals(const std::vector<Arrival>& arrivals) {
  using Kind = Arrival::Kind;
  for (const Arrival& arrival : arrivals) {
    const bool comes = arrival.kind == Kind::live || arrival.kind == Kind::past;
    std::string trouble;
    pulse_->beat();
    try {
      if (arrival.kind == Kind::withdrawn) withdraw(arrival.measurement);
      if (arrival.kind == Kind::replaced) (void)remove(arrival.measurement);
      if (arrival.kind != Kind::withdrawn) add(arrival.measurement, arrival.kind == Kind::live);
      if (arrival.kind == Kind::past)
        judged_from_ = std::max<std::size_t>(judged_from_, arrival.measurement.step);
    } catch (const std::exception& error) {
      trouble = error.what();
      log_event("error", comes ? "a datum cannot be assimilated" : "a datum cannot be taken out",
                {{"site", name()},
                 {"source", arrival.measurement.key.source},
                 {"session", arrival.measurement.key.session},
                 {"seq", arrival.measurement.key.seq},
                 {"step", arrival.measurement.step},
                 {"reason", trouble}});
    }
    const std::lock_guard lock(mutex_);
    --at_hand_;
    stale_lines_ = engine_->stale().size();
    // The failure may have come from the withdrawn datum; if not, the next update says so again.
    if (!trouble.empty() || !comes) failure_ = trouble;
    // No measurement waits for a withdrawal or a switch: its time cannot miss a deadline.
    if (arrival.kind == Kind::live && trouble.empty()) health_.await(arrival.at);
  }
}

void Site::add(const Measurement& measurement, bool is_live) {
  if (measurement.step < 0 || measurement.step >= std::ssize(setup_.problem.model->time))
    throw DataError(fmt::format("step {} is not one of this model", measurement.step));
  const auto datum = std::make_shared<const likelihood::Datum>(measurement.datum());
  const std::lock_guard lock(engine_mutex_);
  const auto start = monotonic_now();
  engine_->add(datum);
  if (verifier_) verifier_->note({datum, true});
  if (is_live) adding_us_[datum->step] += 1e6 * seconds_since(start);
  received_.add(datum->step, measurement.received_ms);
}

void Site::withdraw(const Measurement& measurement) {
  if (remove(measurement)) retract(measurement.step);
}

/// True if its step no longer has data.
bool Site::remove(const Measurement& measurement) {
  if (measurement.step < 0 || measurement.step >= std::ssize(setup_.problem.model->time))
    return false;  // it never came in
  const std::size_t step = measurement.step;
  const std::lock_guard lock(engine_mutex_);
  if (engine_->withdraw(step, measurement.key)) {
    if (verifier_)
      verifier_->note(
          {std::make_shared<const likelihood::Datum>(likelihood::Datum{measurement.key, step, 0, {}, {}}),
           false});
    received_.remove(step, measurement.received_ms);
  }
  return engine_->data().count(step) == 0;
}

/// A step without data has no line, and readers are told that it is gone.
void Site::retract(std::size_t step) {
  auto gone = std::make_shared<Line>();
  gone->step = step;
  gone->time = setup_.problem.model->time[step];
  gone->withdrawn = true;
  gone->event = next_event_++;
  gone->json = files::json_line(Json{
      {"step", step}, {"time", gone->time}, {"withdrawn", true}, {"site", name()}, {"event", gone->event}});
  const auto before = lines_.latest();
  {
    const std::lock_guard lock(mutex_);
    lines_.publish(std::move(gone));
  }
  if (!before || before->step != step) return;
  // What its line began to say holds no more; what the line before it says holds again.
  const auto latest = lines_.latest();
  alarms_.update_conditions(latest ? *latest : Line(), latest && is_informed(*latest, priors_));
}

/// In the order of the steps, because the monitor judges each by those before it. Where many wait the newest
/// is shown first, without the monitor; but not twice in a row, or data that keep coming would keep the
/// others waiting.
void Site::conclude_next() {
  const auto& stale = engine_->stale();
  if (stale.empty()) return;
  previewed_ = stale.size() >= k_newest_first_from && !newest_is_shown_ && !previewed_;
  newest_is_shown_ = newest_is_shown_ || previewed_;
  publish_step(previewed_ ? *stale.rbegin() : *stale.begin(), previewed_);
}

void Site::publish_step(std::size_t step, bool preview) {
  std::shared_ptr<Line> line;
  std::string trouble;
  try {
    // Sums of steps are brought up to date here: who reads them (`form_up_to`) waits for one update.
    const std::lock_guard lock(engine_mutex_);
    assimilation::StepResult result = preview ? engine_->preview(step) : engine_->posterior_at(step);
    model_->amend(result);
    if (const auto added = adding_us_.extract(step)) result.update.elapsed_us.projection += added.mapped();
    observe_phases(result);
    line = line_of(result, model_);
  } catch (const Interrupted&) {  // the service stops, and the next start computes the step
    return;
  } catch (const std::exception& error) {
    trouble = error.what();
    log_event("error", "an update failed", {{"site", name()}, {"step", step}, {"reason", trouble}});
    alarms_.raise(step, "alarm", "trust", "the update failed: " + trouble);
  }
  if (line) {
    if (project_.serve.log_steps)
      log_event("info", "step",
                {{"site", name()}, {"step", step}, {"trusted", line->trusted}, {"remark", line->remark}});
    // A preview does not know what those before it say of it.
    publish(std::move(line), !preview && step >= judged_from_);
  }
  const std::lock_guard lock(mutex_);
  failure_ = trouble;
}

void Site::publish(std::shared_ptr<Line> line, bool judged) {
  const auto latest = lines_.latest();
  if (judged && (!latest || latest->step <= line->step))
    alarms_.update_conditions(*line, is_informed(*line, priors_));
  const std::lock_guard lock(mutex_);
  lines_.publish(std::move(line));
}

void Site::observe_phases(const assimilation::StepResult& step) {
  const auto& elapsed = step.update.elapsed_us;
  for (const auto& [phase, us] : {std::pair{"projection", elapsed.projection},
                                  {"map", elapsed.map},
                                  {"correction", elapsed.correction},
                                  {"forecast", step.forecast_us}})
    metrics_.observe("knothe_phase_seconds", labels(fmt::format("phase=\"{}\"", phase)), 1e-6 * us);
}

std::shared_ptr<Line> Site::line_of(const assimilation::StepResult& step,
                                    std::shared_ptr<const ServedModel> model) {
  const assimilation::UpdateResult& result = step.update;
  auto line = make_line(step, std::move(model), engine_->data().last(result.step)->values);
  for (const std::int64_t sensor : logbook_.off_at(result.step))  // that it is silent is no news
    std::erase(line->absent, sensor);
  Json record = record::step_record(step, setup_.model.contents().axes);
  metrics_.set("knothe_effective_sample_size_ratio", labels(), result.effective_sample_size);
  metrics_.set("knothe_log_evidence", labels(), result.log_evidence);
  record["site"] = name();
  record["data"] = engine_->data().count(result.step);
  record["received_at"] = 1e-3 * received_.last(result.step);
  record["event"] = line->event = next_event_++;
  line->json = files::json_line(record);
  return line;
}

// --- The full-order model --------------------------------------------------------------------------------

/// mutex_ is held.
bool Site::has_verification_to_do() const {
  return verifier_ && ready_ && (verifier_->has_news() || (verification_wanted_ && !verifier_->is_busy()));
}

/// What the verifier has found, where no datum waits: one line at a time, then its engine.
void Site::adopt_verification() {
  if (!verifier_ || !engine_->stale().empty()) return;
  if (auto next = verifier_->next_result()) {
    const std::size_t step = next->result.update.step;
    // A step whose data were withdrawn meanwhile has no line.
    if (engine_->data().count(step) > 0)
      publish(line_of(next->result, std::move(next->model)), step >= judged_from_);
    return;
  }
  auto handover = verifier_->handover();
  if (!handover) return;
  if (handover->model->verification.version != model_->verification.version)
    log_event("info", "another model is used",
              {{"site", name()}, {"reason", text_of(handover->model->verification)}});
  apply_changes(handover->changes, *handover->engine);
  {
    const std::lock_guard lock(engine_mutex_);
    engine_.swap(handover->engine);
    model_ = handover->model;
  }
  verifier_->discard(std::move(handover->engine));
  const std::lock_guard lock(mutex_);
  verification_ = model_->verification;
}

/// Where the verdict doubts the model, with half of the runs; with all of them on request, and at the end of
/// the test. One question at a time.
void Site::ask_full_order_model() {
  if (!verifier_ || verifier_->is_busy() || !engine_->stale().empty()) return;
  const auto latest = lines_.latest();
  bool thorough = false;
  {
    const std::lock_guard lock(mutex_);
    if (!ready_ || !arrivals_.empty()) return;
    thorough = std::exchange(verification_wanted_, false);
  }
  if (!latest) return;
  const Verification& last = model_->verification;
  const bool has_moved =
      asked_mean_.size() == 0 ||
      ((latest->mean - asked_mean_).cwiseQuotient(latest->std)).cwiseAbs().maxCoeff() > k_moved_std;
  const bool doubted = latest->model_doubted && last.trouble.empty() && has_moved &&
                       last.runs < static_cast<std::size_t>(project_.method.verify_runs / 2);
  if (!thorough && !doubted) return;
  asked_mean_ = latest->mean;
  verifier_->ask({engine_->data(), latest->step, thorough, model_});
}

/// From the verifier's thread.
bool Site::store_verification(const Verification& verification) {
  try {
    journal_.enter(entry_of(verification));
    return true;
  } catch (const RequestError& error) {
    log_event("error", "what the full-order model said could not be kept",
              {{"site", name()}, {"reason", error.what()}});
    return false;
  }
}

/// Live data whose line is published now: were they in time?
void Site::check_delays() {
  SiteHealth::Delays delays;
  {
    const std::lock_guard lock(mutex_);
    if (stale_lines_ > 0) return;
    delays = health_.finish();
  }
  for (const double delay : delays.seconds) {
    metrics_.observe("knothe_phase_seconds", labels("phase=\"visible\""), delay);
    if (delay > delays.budget) metrics_.count("knothe_deadline_misses_total", labels());
  }
}

// --- The logbook -----------------------------------------------------------------------------------------

/// The model time of a step; without one, of the latest.
double Site::time_of(std::optional<std::int64_t> step) const {
  const std::vector<double>& times = setup_.problem.model->time;
  const auto latest = lines_.latest();
  if (!step) return times[latest ? latest->step : 0];
  if (*step < 0 || *step >= std::ssize(times))
    throw RequestError(
        400, "Malformed",
        fmt::format("\"step\" is {}; the model has the steps 0 to {}", *step, times.size() - 1));
  return times[*step];
}

void Site::require_test(const std::optional<std::string>& asked) const {
  if (!asked || *asked == test()) return;
  throw RequestError(
      409, "OtherTest",
      fmt::format("the datum is for {}, and {} runs: it was not stored. Resume the one that it "
                  "is for (POST /v1/tests/resume), or leave \"test\" out",
                  test_in_words(*asked), test_in_words(test())));
}

LogbookEntry Site::entry(EntryKind kind, const EntryRequest& request, std::int64_t alarm) const {
  LogbookEntry entry{0, kind, 0, 0, request.author, request.text, 0};
  switch (kind) {
    case EntryKind::note:
      if (request.text.empty()) throw RequestError(400, "Malformed", "\"text\" must not be empty");
      entry.time = time_of(request.step);
      break;
    case EntryKind::sensor_on:
    case EntryKind::sensor_off:
      if (!request.active)
        throw RequestError(400, "Malformed", "\"active\" is missing: false switches the sensor off, true on");
      entry.kind = *request.active ? EntryKind::sensor_on : EntryKind::sensor_off;
      entry.subject = sensor_of(request, setup_.measurements.sensors);
      entry.time = time_of(request.step);
      break;
    case EntryKind::acknowledgement: {
      const auto found = alarms_.find(alarm);
      if (!found)
        throw RequestError(404, "UnknownAlarm",
                           fmt::format("there is no alarm {} among the last {}", alarm, SiteAlarms::k_kept));
      const std::size_t step = std::max<std::int64_t>(found->step, 0);
      entry.subject = alarm;
      entry.time = setup_.problem.model->time[std::min(step, setup_.problem.model->time.size() - 1)];
      break;
    }
    case EntryKind::verification_asked:
      if (!verifier_)
        throw RequestError(
            409, "NotVerified",
            "the full-order model is not asked here: set verify = \"full-order\" under [method]");
      if (!lines_.latest())
        throw RequestError(409, "NoState", "there are no data yet: there is no posterior to ask at");
      entry.time = time_of(std::nullopt);
      break;
    default:  // the test is finished or resumed
      entry.time = time_of(std::nullopt);
  }
  return entry;
}

// --- State -----------------------------------------------------------------------------------------------

SiteHealth::State Site::state_of_now(const JournalWriter::Tally& tally) const {
  std::string finished;
  if (const auto entry = logbook_.finished())
    finished = entry->kind == EntryKind::test_followed
                   ? fmt::format("the test \"{}\" has taken the place of this one", entry->text)
                   : fmt::format("the test was finished by {}{}{}", entry->author,
                                 entry->text.empty() ? "" : ": ", entry->text);
  return health_.state(
      {lines_.latest(), failure_, replayed_ && !ready_, tally.read_only, tally.trouble, finished});
}

bool Site::tick() {
  JournalWriter::Tally tally;
  SiteHealth::State state;
  std::optional<double> age;
  std::size_t pending = 0;
  std::int64_t records = 0;
  std::shared_ptr<const Line> latest;
  Verification verification;
  bool replaying = false;  // a restart is no delay of the data
  {
    const std::lock_guard lock(mutex_);
    verification = verification_;
    replaying = replayed_ && !ready_;
    tally = journal_.tally();
    state = state_of_now(tally);
    age = health_.data_age_s();
    pending = health_.awaited() + arrivals_.size() + at_hand_;
    records = records_;
    latest = lines_.latest();
  }
  const std::int64_t step = latest ? static_cast<std::int64_t>(latest->step) : -1;
  for (const char* word : {"OK", "DEGRADED", "STALE", "BIASED", "DIVERGED", "FINISHED"})
    metrics_.set("knothe_state", labels(fmt::format("state=\"{}\"", word)), state.word == word ? 1 : 0);
  for (const char* flow : SiteHealth::k_data_flows)
    metrics_.set("knothe_data_flow", labels(fmt::format("flow=\"{}\"", flow)),
                 state.data_flow == flow ? 1 : 0);
  if (latest)
    for (const auto& level : names_of(latest->verdict))
      metrics_.set("knothe_structure", labels(fmt::format("level=\"{}\"", level.word)),
                   latest->verdict == level.value ? 1 : 0);
  if (age) metrics_.set("knothe_data_age_seconds", labels(), *age);
  metrics_.set("knothe_pending_measurements", labels(), pending);
  metrics_.set("knothe_journal_records", labels(), records);
  metrics_.set("knothe_quarantined_measurements", labels(), tally.quarantined);
  metrics_.set("knothe_unacknowledged_alarms", labels(), alarms_.unacknowledged());
  if (verifier_) {
    metrics_.set("knothe_full_order_runs", labels(), verification.runs);
    metrics_.set("knothe_model_version", labels(), verification.version);
  }
  if (step >= 0) metrics_.set("knothe_step", labels(), step);
  const std::size_t at = std::max<std::int64_t>(step, 0);
  const bool silent = state.data_flow == "silent";
  if (age || !silent) alarms_.update_condition("data", at, silent ? "warning" : "", "gap", state.silence);
  if (!health_.update_state(state)) return false;
  log_event(state.word == "OK" || state.word == "FINISHED" ? "info" : "warning", "state",
            {{"site", name()},
             {"state", state.word},
             {"reason", state.reason},
             {"data_flow", state.data_flow},
             {"step", step}});
  if (state.word == "DEGRADED" && !replaying) alarms_.raise(at, "warning", "deadline", state.reason);
  return true;
}

void Site::forget_gauges() {
  for (const char* name : {"knothe_step", "knothe_log_evidence", "knothe_effective_sample_size_ratio",
                           "knothe_data_age_seconds"})
    metrics_.forget(name, labels());
  for (const auto& level : names_of(assimilation::VerdictLevel()))
    metrics_.forget("knothe_structure", labels(fmt::format("level=\"{}\"", level.word)));
}

Json Site::status() const {
  const std::lock_guard lock(mutex_);
  const JournalWriter::Tally tally = journal_.tally();
  const SiteHealth::State state = state_of_now(tally);
  Json status = {{"site", name()},
                 {"journal", journal_.id()},
                 {"state", state.word},
                 {"reason", state.reason},
                 {"data_flow", state.data_flow}};
  if (!test().empty()) status["test"] = test();
  if (const auto latest = lines_.latest()) {
    const Line& line = *latest;
    status["step"] = line.step;
    status["time"] = line.time;
    status["structure"] = to_text(line.verdict);
    if (const auto off = logbook_.off_at(line.step); !off.empty()) status["switched_off"] = off;
    status["misfit"] = misfit_record(line.misfit);
  }
  if (const auto age = health_.data_age_s()) status["data_age_s"] = *age;
  if (const auto period = health_.period_s()) status["period_s"] = *period;
  if (verifier_) {
    status["refinement"] = {{"version", verification_.version},
                            {"full_order_runs", verification_.runs},
                            {"moved_std", verification_.moved_std},
                            {"asking", verifier_->is_busy()}};
    if (!verification_.trouble.empty()) status["refinement"]["trouble"] = verification_.trouble;
  }
  status["budget_us"] = 1e6 * health_.budget_s();
  status["pending"] = health_.awaited() + arrivals_.size() + at_hand_;
  status["behind"] = stale_lines_;
  status["records"] = records_;
  for (const char* outcome : {"accepted", "duplicates", "conflicts", "malformed"}) {
    const auto it = tally.outcomes.find(outcome);
    status[outcome] = it == tally.outcomes.end() ? 0 : it->second;
  }
  status["quarantined"] = tally.quarantined;
  status["unacknowledged"] = alarms_.unacknowledged();
  status["deadline_misses"] = health_.deadline_misses();
  status["read_only"] = tally.read_only;
  status["untrusted"] = lines_.untrusted();
  status["event"] = lines_.last_event();
  status["uptime_s"] = seconds_since(started_);
  status["version"] = k_version;
  return status;
}

}  // namespace knothe::service
