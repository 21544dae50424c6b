#include "knothe/service/site/site_health.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>

#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::service {

void SiteHealth::accept(MonotonicTime at) {
  const std::lock_guard lock(mutex_);
  accepted_at_.push_back(at);
  if (accepted_at_.size() > 32) accepted_at_.pop_front();
}

void SiteHealth::await(MonotonicTime at) {
  const std::lock_guard lock(mutex_);
  awaited_.push_back(at);
}

SiteHealth::Delays SiteHealth::finish() {
  Delays delays{{}, budget_s()};
  const std::lock_guard lock(mutex_);
  if (awaited_.empty()) return delays;
  for (const auto at : awaited_) delays.seconds.push_back(seconds_since(at));
  awaited_.clear();
  last_missed_ = false;
  for (const double delay : delays.seconds) {
    if (delay <= delays.budget) continue;
    ++deadline_misses_;
    last_missed_ = true;
    if (strict_) strict_miss_ = true;
  }
  return delays;
}

std::optional<double> SiteHealth::period_s() const {
  if (options_.period) return options_.period;
  const std::lock_guard lock(mutex_);
  if (accepted_at_.size() < 4) return std::nullopt;
  std::vector<double> intervals;
  for (std::size_t i = 1; i < accepted_at_.size(); ++i)
    intervals.push_back(seconds_between(accepted_at_[i - 1], accepted_at_[i]));
  return numerics::upper_median(std::move(intervals));
}

double SiteHealth::budget_s() const {
  if (options_.budget) return *options_.budget;
  const auto period = period_s();
  if (!period) return 1;  // nothing is known of the pace yet
  return options_.period ? *period : std::max(*period, k_min_budget);
}

std::optional<double> SiteHealth::stale_after_s() const {
  if (options_.stale_after) return options_.stale_after;
  const auto period = period_s();
  if (!period) return std::nullopt;
  return options_.period ? 5 * *period : std::max(5 * *period, 2.0);
}

std::optional<double> SiteHealth::data_age_s() const {
  const std::lock_guard lock(mutex_);
  return accepted_at_.empty() ? std::nullopt : std::optional(seconds_since(accepted_at_.back()));
}

std::size_t SiteHealth::awaited() const {
  const std::lock_guard lock(mutex_);
  return awaited_.size();
}

std::int64_t SiteHealth::deadline_misses() const {
  const std::lock_guard lock(mutex_);
  return deadline_misses_;
}

SiteHealth::State SiteHealth::state(const Facts& facts) const {
  const double budget = budget_s();
  const auto stale_after = stale_after_s();
  const std::lock_guard lock(mutex_);
  const auto now = monotonic_now();
  State state = data_flow(facts, now, stale_after);
  std::tie(state.word, state.reason) = judge(facts, now, budget, state.silence);
  return state;
}

SiteHealth::State SiteHealth::data_flow(const Facts& facts, MonotonicTime now,
                                        std::optional<double> stale_after) const {
  if (!facts.finished.empty()) return {"", "", "finished", ""};
  if (accepted_at_.empty() && !facts.latest && !facts.replaying)
    return {"", "", "waiting", "no measurement yet"};
  if (accepted_at_.empty()) return {"", "", "silent", "no measurement since the service was started"};
  if (stale_after && seconds_between(accepted_at_.back(), now) > *stale_after)
    return {"", "", "silent", fmt::format("no measurement for more than {:.3g} s", *stale_after)};
  return {"", "", "arriving", ""};
}

std::pair<std::string, std::string> SiteHealth::judge(const Facts& facts, MonotonicTime now, double budget,
                                                      const std::string& silence) const {
  if (!facts.failure.empty()) return {"DIVERGED", "the last update failed: " + facts.failure};
  if (const std::string stuck = pulses_.complaint(now); !stuck.empty()) return {"DEGRADED", stuck};
  if (facts.read_only)
    return {"DEGRADED", "measurements are refused, because they cannot be stored: " + facts.trouble};
  double oldest = 0;
  for (const auto at : awaited_) oldest = std::max(oldest, seconds_between(at, now));
  if (oldest > budget)
    return {"DEGRADED",
            fmt::format("updates are {:.0f} ms behind; what is shown is the last that was verified",
                        1e3 * oldest)};
  if (facts.replaying) return {"DEGRADED", "the journal is being replayed"};
  if (!facts.finished.empty()) return {"FINISHED", facts.finished};
  if (silence.empty() && last_missed_)
    return {"DEGRADED", fmt::format("the last update was later than its budget of {:.1f} ms", 1e3 * budget)};
  // A model that does not fit is told also where no data arrive.
  if (facts.latest && facts.latest->monitor_alarm)
    return {"BIASED",
            facts.latest->bias_corrected
                ? "the model, corrected for its bias, has not explained the last data"
                : "the model has not explained the last data: they drift away from what it predicts"};
  if (facts.latest && facts.latest->is_biased()) return {"BIASED", facts.latest->misfit_message};
  if (!silence.empty()) return {"STALE", silence};
  return {"OK", ""};
}

bool SiteHealth::update_state(const State& state) {
  const std::lock_guard lock(mutex_);
  const bool changed = state.word != state_.word || state.data_flow != state_.data_flow ||
                       (state.word != "DEGRADED" && state.reason != state_.reason);
  state_ = state;
  if (changed) ++state_version_;
  return changed;
}

}  // namespace knothe::service
