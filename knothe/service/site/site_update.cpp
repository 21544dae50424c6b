/// @file The part of a site that makes posteriors of what the journal has: its updating thread.
#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>

#include "knothe/base/error.hpp"
#include "knothe/service/site/log.hpp"
#include "knothe/service/site/site.hpp"

namespace knothe::service {
namespace {

constexpr std::size_t k_newest_first_from = 16;  // stale lines

double seconds_since(MonotonicClock::time_point at) {
  return std::chrono::duration<double>(MonotonicClock::now() - at).count();
}

}  // namespace

void Site::update_loop() {
  while (true) {
    std::vector<Arrival> arrivals;
    bool finish = false;
    {
      std::unique_lock lock(mutex_);
      arrivals_there_.wait(lock, [&] {
        return !arrivals_.empty() || no_more_arrivals_ || (replayed_ && (!ready_ || stale_lines_ > 0));
      });
      // Stopping: what is accepted is in the journal, and the next start computes it; the step at hand is
      // done.
      if (no_more_arrivals_) return;
      arrivals.assign(std::make_move_iterator(arrivals_.begin()), std::make_move_iterator(arrivals_.end()));
      arrivals_.clear();
      at_hand_ = arrivals.size();
      finish = replayed_;
    }
    take(arrivals);
    if (!arrivals.empty()) newest_is_shown_ = false;
    conclude_next();
    const auto& stale = engine_.stale();
    {
      const std::lock_guard lock(mutex_);
      stale_lines_ = stale.size();
      if (finish && !ready_) {
        ::malloc_trim(0);  // what reading model and journal took and gave back to nobody
        ready_ = true;
        log_event("info", "ready",
                  {{"site", name_}, {"records", records_}, {"elapsed_s", seconds_since(started_)}});
      }
    }
    judge_latency();
    changed_();
  }
}

void Site::take(const std::vector<Arrival>& arrivals) {
  for (const Arrival& arrival : arrivals) {
    std::string trouble;
    try {
      if (arrival.measurement.step < 0 ||
          static_cast<std::size_t>(arrival.measurement.step) >= setup_.observed->time.size())
        throw DataError(fmt::format("step {} is not one of this model", arrival.measurement.step));
      const assimilation::Datum datum = arrival.measurement.datum();
      const std::lock_guard lock(engine_mutex_);
      engine_.add(datum);
      std::int64_t& received = received_ms_[datum.step];
      received = std::max(received, arrival.measurement.received_ms);
    } catch (const std::exception& error) {
      trouble = error.what();
      log_event("error", "a datum cannot be assimilated",
                {{"site", name_},
                 {"source", arrival.measurement.key.source},
                 {"session", arrival.measurement.key.session},
                 {"seq", arrival.measurement.key.seq},
                 {"step", arrival.measurement.step},
                 {"reason", trouble}});
    }
    const std::lock_guard lock(mutex_);
    --at_hand_;
    stale_lines_ = engine_.stale().size();
    if (!trouble.empty()) failure_ = trouble;
    if (arrival.live && trouble.empty()) waiting_.push_back(arrival.at);
  }
}

/// In the order of the steps, because the monitor judges each by those before it. Where many wait the newest
/// is shown first, without the monitor; but not twice in a row, or data that keep coming would keep the
/// others waiting.
void Site::conclude_next() {
  const auto& stale = engine_.stale();
  if (stale.empty()) return;
  previewed_ = stale.size() >= k_newest_first_from && !newest_is_shown_ && !previewed_;
  newest_is_shown_ = newest_is_shown_ || previewed_;
  conclude(previewed_ ? *stale.rbegin() : *stale.begin(), previewed_);
}

void Site::conclude(std::size_t step, bool preview) {
  std::shared_ptr<Line> line;
  std::string trouble;
  try {
    // Sums of steps are brought up to date here: who reads them (`form_up_to`) waits for one update.
    const std::lock_guard lock(engine_mutex_);
    line = make_line(preview ? engine_.preview(step) : engine_.conclude(step));
  } catch (const std::exception& error) {
    trouble = error.what();
    log_event("error", "an update failed", {{"site", name_}, {"step", step}, {"reason", trouble}});
    raise(step, "alarm", "trust", "the update failed: " + trouble);
  }
  if (line) {
    if (project_.serve.log_steps)
      log_event("info", "step",
                {{"site", name_}, {"step", step}, {"trusted", line->trusted}, {"remark", line->remark}});
    publish(std::move(line));
  }
  const std::lock_guard lock(mutex_);
  failure_ = trouble;
}

void Site::publish(std::shared_ptr<Line> line) {
  const bool newest = [&] {
    const std::lock_guard lock(mutex_);
    return lines_.empty() || lines_.rbegin()->first <= line->step;
  }();
  if (newest) raise_alarms(*line);
  const std::lock_guard lock(mutex_);
  if (const auto it = lines_.find(line->step); it != lines_.end()) events_.erase(it->second->event);
  events_[line->event] = line->step;
  lines_[line->step] = std::move(line);
}

/// Live data whose line is published now: were they in time?
void Site::judge_latency() {
  std::vector<double> latencies;
  double budget = 0;
  {
    const std::lock_guard lock(mutex_);
    if (stale_lines_ > 0 || waiting_.empty()) return;
    budget = budget_locked();
    for (const auto at : waiting_) latencies.push_back(seconds_since(at));
    waiting_.clear();
    last_missed_ = false;
    for (const double latency : latencies) {
      if (latency <= budget) continue;
      ++deadline_misses_;
      last_missed_ = true;
      if (strict_) strict_miss_ = true;
    }
  }
  for (const double latency : latencies) {
    metrics_.observe("knothe_phase_seconds", labels("phase=\"visible\""), latency);
    if (latency > budget) metrics_.count("knothe_deadline_misses_total", labels());
  }
}

}  // namespace knothe::service
