/// @file What a site says of itself: lines, states, alarms.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/version.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/report/results/step_record.hpp"
#include "knothe/service/site/log.hpp"
#include "knothe/service/site/site.hpp"

namespace knothe::service {
namespace {

constexpr Eigen::Index k_samples = 400;
constexpr double k_bias_probability = 1e-4;
constexpr double k_least_budget = 0.01;  // s, where it is derived from the period
constexpr std::size_t k_alarms_kept = 256;

double seconds_between(MonotonicClock::time_point a, MonotonicClock::time_point b) {
  return std::chrono::duration<double>(b - a).count();
}

/// P(χ²_n > x), by the cube root of Wilson and Hilferty (1931): within 0.005 of the exact value for n ≥ 3,
/// and an alarm needs no more.
double chi_squared_tail(double x, double n) {
  if (n <= 0) return 1;
  const double variance = 2 / (9 * n);
  const double z = (std::cbrt(x / n) - (1 - variance)) / std::sqrt(variance);
  return 0.5 * std::erfc(z / std::sqrt(2.0));
}

/// Draws in the middle of equal shares of the weight: the same every time.
Eigen::MatrixXd systematic_draws(const assimilation::Posterior& posterior) {
  const Eigen::Index n = std::min(k_samples, posterior.points.rows());
  Eigen::MatrixXd drawn(n, posterior.points.cols());
  const double share = posterior.weights.sum() / static_cast<double>(n);
  double cumulative = posterior.weights[0];
  for (Eigen::Index k = 0, i = 0; k < n; ++k) {
    while (cumulative < (static_cast<double>(k) + 0.5) * share && i + 1 < posterior.points.rows())
      cumulative += posterior.weights[++i];
    drawn.row(k) = posterior.points.row(i);
  }
  return drawn;
}

}  // namespace

Json Alarm::json() const {
  return {{"id", id}, {"step", step}, {"severity", severity}, {"kind", kind}, {"message", message}};
}

std::shared_ptr<Line> Site::make_line(const engine::StepResult& step) {
  const assimilation::UpdateResult& result = step.update;
  auto line = std::make_shared<Line>();
  line->step = result.step;
  line->time = result.time;
  line->mean = result.mean;
  line->std = result.covariance.diagonal().cwiseSqrt();
  line->samples = systematic_draws(step.update);
  line->trusted = result.trusted;
  line->remark = result.remark;
  line->monitor_alarm = result.monitor.alarm;
  line->bias_corrected = result.bias_corrected;
  line->notice = result.notice;
  line->stuck = step.stuck, line->absent = step.absent;
  line->bias_functions = step.bias_functions, line->bias_sensors = step.bias_sensors;
  line->residual = engine_.last_values(result.step) - setup_.observed->predict(result.mean, result.step);
  for (Eigen::Index i = 0; i < line->residual.size(); ++i) {
    const bool missing = std::isnan(line->residual[i]);
    line->missing.push_back(missing);
    if (missing) line->residual[i] = 0;
    line->misfit_values += missing ? 0 : 1;
    line->misfit += std::pow(line->residual[i] / sensor_std_[i], 2);
  }
  const assimilation::NoiseModel& noise = setup_.measurements.noise;
  if (!noise.is_independent()) {
    // Correlated errors: rᵀ R⁻¹ r, of complete data only.
    if (line->misfit_values < line->residual.size()) line->misfit_values = 0;
    line->misfit = line->misfit_values == 0 ? 0 : line->residual.dot(noise.apply(line->residual).col(0));
  }
  line->misfit_probability = chi_squared_tail(line->misfit, static_cast<double>(line->misfit_values));
  Json record = report::step_record(step);
  for (const forecast::NamedForecast& named : step.forecasts)
    line->above_threshold[named.name] = named.forecast.probability_above_threshold;
  for (const auto& [phase, us] : {std::pair{"projection", result.elapsed_us.projection},
                                  {"map", result.elapsed_us.map},
                                  {"correction", result.elapsed_us.correction},
                                  {"forecast", step.forecast_us}})
    metrics_.observe("knothe_phase_seconds", labels(fmt::format("phase=\"{}\"", phase)), 1e-6 * us);
  metrics_.set("knothe_effective_sample_size_ratio", labels(), result.effective_sample_size);
  metrics_.set("knothe_log_evidence", labels(), result.log_evidence);
  record["site"] = name_;
  record["data"] = engine_.data_count(result.step);
  record["received_at"] = 1e-3 * static_cast<double>(received_ms_.at(result.step));
  {
    const std::lock_guard lock(mutex_);
    line->event = next_event_++;
  }
  record["event"] = line->event;
  line->json = files::json_line(record);
  return line;
}

// --- State ------------------------------------------------------------------------------------------------

std::optional<double> Site::period_locked() const {
  if (project_.serve.period) return project_.serve.period;
  if (accepted_at_.size() < 4) return std::nullopt;
  std::vector<double> intervals;
  for (std::size_t i = 1; i < accepted_at_.size(); ++i)
    intervals.push_back(seconds_between(accepted_at_[i - 1], accepted_at_[i]));
  const auto middle = intervals.begin() + static_cast<std::ptrdiff_t>(intervals.size() / 2);
  std::nth_element(intervals.begin(), middle, intervals.end());
  return *middle;
}

double Site::budget_locked() const {
  if (project_.serve.budget) return *project_.serve.budget;
  const auto period = period_locked();
  if (!period) return 1;  // nothing is known of the pace yet
  return project_.serve.period ? 0.1 * *period : std::max(0.1 * *period, k_least_budget);
}

std::optional<double> Site::period_s() const {
  const std::lock_guard lock(mutex_);
  return period_locked();
}
double Site::budget_s() const {
  const std::lock_guard lock(mutex_);
  return budget_locked();
}
std::optional<double> Site::stale_after_s() const {
  if (project_.serve.stale_after) return project_.serve.stale_after;
  const auto period = period_s();
  if (!period) return std::nullopt;
  return project_.serve.period ? 5 * *period : std::max(5 * *period, 2.0);
}

Site::State Site::state_of_now() const {
  const auto now = MonotonicClock::now();
  if (!failure_.empty()) return {"DIVERGED", "the last update failed: " + failure_};
  if (read_only_)
    return {"DEGRADED", "the disk is full, or cannot be written: measurements are refused until it can"};
  double oldest = 0;
  for (const auto at : waiting_) oldest = std::max(oldest, seconds_between(at, now));
  const double budget = budget_locked();
  if (oldest > budget)
    return {"DEGRADED",
            fmt::format("updates are {:.0f} ms behind; what is shown is the last that was verified",
                        1e3 * oldest)};
  if (replayed_ && !ready_) return {"DEGRADED", "the journal is being replayed"};
  if (lines_.empty() && accepted_at_.empty()) return {"STALE", "no measurement yet"};
  std::optional<double> stale_after = project_.serve.stale_after;
  if (!stale_after) {
    if (const auto period = period_locked())
      stale_after = project_.serve.period ? 5 * *period : std::max(5 * *period, 2.0);
  }
  if (accepted_at_.empty()) return {"STALE", "no measurement since the service was started"};
  if (stale_after && seconds_between(accepted_at_.back(), now) > *stale_after)
    return {"STALE", fmt::format("no measurement for more than {:.3g} s", *stale_after)};
  if (last_missed_)
    return {"DEGRADED", fmt::format("the last update was later than its budget of {:.1f} ms", 1e3 * budget)};
  if (lines_.empty()) return {"OK", ""};
  const Line& line = *lines_.rbegin()->second;
  if (line.monitor_alarm)
    return {"BIASED",
            line.bias_corrected
                ? "the model, corrected for its bias, has not explained the last data"
                : "the model has not explained the last data: they drift away from what it predicts"};
  if (!line.bias_corrected && line.misfit_probability < k_bias_probability)
    return {
        "BIASED",
        fmt::format(
            "the last datum does not fit the model: its χ² at the posterior mean is {:.4g} with {} values",
            line.misfit, line.misfit_values)};
  return {"OK", ""};
}

bool Site::tick() {
  State state;
  std::optional<double> age;
  std::int64_t pending = 0, records = 0, held = 0, step = -1;
  bool changed = false;
  {
    const std::lock_guard lock(mutex_);
    state = state_of_now();
    changed = state.word != state_.word || (state.word != "DEGRADED" && state.reason != state_.reason);
    state_ = state;
    if (!accepted_at_.empty()) age = seconds_between(accepted_at_.back(), MonotonicClock::now());
    pending = static_cast<std::int64_t>(waiting_.size() + arrivals_.size() + at_hand_);
    records = records_, held = static_cast<std::int64_t>(quarantine_.size());
    if (!lines_.empty()) step = static_cast<std::int64_t>(lines_.rbegin()->first);
  }
  for (const char* word : {"OK", "DEGRADED", "STALE", "BIASED", "DIVERGED"})
    metrics_.set("knothe_state", labels(fmt::format("state=\"{}\"", word)), state.word == word ? 1 : 0);
  if (age) metrics_.set("knothe_data_age_seconds", labels(), *age);
  metrics_.set("knothe_pending_measurements", labels(), static_cast<double>(pending));
  metrics_.set("knothe_journal_records", labels(), static_cast<double>(records));
  metrics_.set("knothe_quarantined_measurements", labels(), static_cast<double>(held));
  if (step >= 0) metrics_.set("knothe_step", labels(), static_cast<double>(step));
  if (!changed) return false;
  ++state_version_;
  log_event(state.word == "OK" ? "info" : "warning", "state",
            {{"site", name_}, {"state", state.word}, {"reason", state.reason}, {"step", step}});
  if (state.word == "STALE" && age)
    raise(static_cast<std::size_t>(std::max<std::int64_t>(step, 0)), "warning", "gap", state.reason);
  if (state.word == "DEGRADED")
    raise(static_cast<std::size_t>(std::max<std::int64_t>(step, 0)), "warning", "deadline", state.reason);
  return true;
}

Json Site::status() const {
  const std::lock_guard lock(mutex_);
  const State state = state_of_now();
  Json status = {{"site", name_}, {"state", state.word}, {"reason", state.reason}};
  if (!lines_.empty()) {
    const Line& line = *lines_.rbegin()->second;
    status["step"] = line.step;
    status["time"] = line.time;
    status["misfit"] = {
        {"statistic", line.misfit}, {"values", line.misfit_values}, {"probability", line.misfit_probability}};
  }
  if (!accepted_at_.empty())
    status["data_age_s"] = seconds_between(accepted_at_.back(), MonotonicClock::now());
  if (const auto period = period_locked()) status["period_s"] = *period;
  status["budget_us"] = 1e6 * budget_locked();
  status["pending"] = waiting_.size() + arrivals_.size() + at_hand_;
  status["behind"] = stale_lines_;
  status["records"] = records_;
  for (const char* outcome : {"accepted", "duplicates", "conflicts", "malformed"}) {
    const auto it = outcomes_.find(outcome);
    status[outcome] = it == outcomes_.end() ? 0 : it->second;
  }
  status["quarantined"] = quarantine_.size();
  status["deadline_misses"] = deadline_misses_;
  status["read_only"] = read_only_;
  Json untrusted = Json::array();
  for (const auto& [step, line] : lines_)
    if (!line->trusted) untrusted.push_back(step);
  status["untrusted"] = untrusted;
  status["event"] = events_.empty() ? 0 : events_.rbegin()->first;
  status["uptime_s"] = seconds_between(started_, MonotonicClock::now());
  status["version"] = k_version;
  return status;
}

// --- Alarms -----------------------------------------------------------------------------------------------

void Site::raise(std::size_t step, const std::string& severity, const std::string& kind,
                 const std::string& message) {
  const std::lock_guard lock(mutex_);
  alarms_.push_back({next_event_++, step, severity, kind, message});
  if (alarms_.size() > k_alarms_kept) alarms_.pop_front();
}

void Site::warn(const std::string& kind, const std::string& message) {
  const auto line = latest();
  raise(line ? line->step : 0, "warning", kind, message);
}

void Site::show_picture(double time, std::string file) {
  const auto& times = setup_.observed->time;
  const auto nearest = std::min_element(times.begin(), times.end(), [&](double a, double b) {
    return std::abs(a - time) < std::abs(b - time);
  });
  if (nearest == times.end()) return;
  const std::lock_guard lock(mutex_);
  pictures_[static_cast<std::size_t>(nearest - times.begin())] = std::move(file);
}

std::string Site::picture_of(std::size_t step) const {
  const std::lock_guard lock(mutex_);
  const auto it = pictures_.find(step);
  return it == pictures_.end() ? "" : it->second;
}

bool Site::holds(const assimilation::DatumKey& key) const {
  const std::lock_guard lock(mutex_);
  return from_folders_.contains(key);
}

/// An alarm is raised when its condition begins to hold, not again while it holds.
void Site::raise_alarms(const Line& line) {
  const auto judge = [&](const std::string& condition, const std::string& severity, const std::string& kind,
                         const std::string& message) {
    std::string& before = alarm_conditions_[condition];
    if (before != severity && !severity.empty()) raise(line.step, severity, kind, message);
    before = severity;
  };
  for (const forecast::ForecastSpecification& specification : project_.forecasts) {
    const auto it = line.above_threshold.find(specification.name);
    if (it == line.above_threshold.end() || !specification.threshold) continue;
    const double p = it->second;
    judge("threshold " + specification.name,
          p >= 0.5    ? "alarm"
          : p >= 0.05 ? "warning"
                      : "",
          "threshold",
          fmt::format("P({} > {:g}) is {:.3g}", specification.name, *specification.threshold, p));
  }
  judge("bias", !line.bias_corrected && line.misfit_probability < k_bias_probability ? "alarm" : "", "bias",
        fmt::format("the datum does not fit the model: χ² {:.4g} with {} values", line.misfit,
                    line.misfit_values));
  judge("monitor", line.monitor_alarm ? "alarm" : "", "bias",
        line.notice.empty() ? "the model does not explain the data" : line.notice);
  judge("correction", line.bias_corrected ? "info" : "", "bias", "the model's bias is corrected from now on");
  judge("trust", line.trusted ? "" : "info", "trust", line.remark);
  const auto missing = std::count(line.missing.begin(), line.missing.end(), true);
  judge("sensors", 10 * missing > static_cast<std::ptrdiff_t>(line.missing.size()) ? "warning" : "",
        "sensors", fmt::format("{} of {} sensors are missing", missing, line.missing.size()));
  judge("stuck", line.stuck.empty() ? "" : "warning", "sensors",
        fmt::format("the same value at five steps while the model moves: sensors {}",
                    fmt::join(line.stuck, ", ")));
  judge("absent", line.absent.empty() ? "" : "warning", "sensors",
        fmt::format("no value at five steps: sensors {}", fmt::join(line.absent, ", ")));
}

std::vector<Alarm> Site::alarms(std::int64_t after) const {
  const std::lock_guard lock(mutex_);
  std::vector<Alarm> found;
  for (const Alarm& alarm : alarms_)
    if (alarm.id > after) found.push_back(alarm);
  return found;
}

// --- Reading ----------------------------------------------------------------------------------------------

bool Site::ready() const {
  const std::lock_guard lock(mutex_);
  return ready_ && !stopping_;
}

std::shared_ptr<const Line> Site::latest() const {
  const std::lock_guard lock(mutex_);
  return lines_.empty() ? nullptr : lines_.rbegin()->second;
}

std::shared_ptr<const Line> Site::line(std::size_t step) const {
  const std::lock_guard lock(mutex_);
  const auto it = lines_.find(step);
  return it == lines_.end() ? nullptr : it->second;
}

std::vector<std::shared_ptr<const Line>> Site::lines(std::size_t from) const {
  const std::lock_guard lock(mutex_);
  std::vector<std::shared_ptr<const Line>> found;
  for (auto it = lines_.lower_bound(from); it != lines_.end(); ++it) found.push_back(it->second);
  return found;
}

std::shared_ptr<const Line> Site::next_line(std::int64_t event) const {
  const std::lock_guard lock(mutex_);
  const auto it = events_.upper_bound(event);
  return it == events_.end() ? nullptr : lines_.at(it->second);
}

std::int64_t Site::last_event() const {
  const std::lock_guard lock(mutex_);
  return events_.empty() ? 0 : events_.rbegin()->first;
}

Json Site::quarantine() const {
  const std::lock_guard lock(mutex_);
  Json list = Json::array();
  for (const JournalEntry& entry : quarantine_) {
    const Measurement& d = entry.measurement;
    list.push_back({{"source", d.key.source},
                    {"session", d.key.session},
                    {"seq", d.key.seq},
                    {"time", d.time},
                    {"step", d.step}});
  }
  return {{"quarantined", list}};
}

std::optional<assimilation::StepForm> Site::form_up_to(std::size_t step) {
  const std::lock_guard lock(engine_mutex_);
  return engine_.form_up_to(step);
}

bool Site::settled() const {
  const std::lock_guard lock(mutex_);
  return requests_.empty() && arrivals_.empty() && at_hand_ == 0 && stale_lines_ == 0;
}

}  // namespace knothe::service
