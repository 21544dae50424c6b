#pragma once
/// @file State of a site: the pace of its data, the delays of its lines, its name
/// (docs/reference/service.md).
#include <array>
#include <atomic>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "knothe/base/monotonic_time.hpp"
#include "knothe/project/serve_options.hpp"
#include "knothe/service/site/line.hpp"
#include "knothe/service/site/pulses.hpp"

namespace knothe::service {

/// Thread-safe; its mutex is taken last.
class SiteHealth {
 public:
  struct State {
    std::string word, reason;
    std::string data_flow;  ///< one of k_data_flows, whatever the word is
    std::string silence;    ///< why `data_flow` is "waiting" or "silent"
  };
  static constexpr std::array<const char*, 4> k_data_flows{"waiting", "arriving", "silent", "finished"};
  /// What the state follows from beside the times.
  struct Facts {
    std::shared_ptr<const Line> latest;
    std::string failure;  ///< of the last update
    bool replaying = false, read_only = false;
    std::string trouble = {};   ///< why it is read-only
    std::string finished = {};  ///< who has finished the test, and why; empty: it goes on
  };
  struct Delays {
    std::vector<double> seconds;  ///< from a datum's request to its line
    double budget = 0;            ///< s, then
  };

  SiteHealth(const project::ServeOptions& options, bool strict_deadline)
      : options_(options), strict_(strict_deadline), state_(state({})) {}

  void accept(MonotonicTime at);  ///< a request whose datum is in the journal now
  void await(MonotonicTime at);   ///< a request whose datum is taken, its line not published yet
  /// The lines of all that was awaited are published now: were they in time?
  Delays finish();

  [[nodiscard]] std::optional<double> period_s() const;
  [[nodiscard]] double budget_s() const;
  [[nodiscard]] std::optional<double> stale_after_s() const;
  [[nodiscard]] std::optional<double> data_age_s() const;  ///< since the last was accepted
  [[nodiscard]] std::size_t awaited() const;
  [[nodiscard]] std::int64_t deadline_misses() const;
  [[nodiscard]] bool missed_strict_deadline() const { return strict_miss_.load(); }

  /// Of the site's threads.
  [[nodiscard]] Pulses& pulses() const { return pulses_; }
  [[nodiscard]] State state(const Facts& facts) const;
  /// Sets the state. True if it is another than before.
  bool update_state(const State& state);
  [[nodiscard]] std::int64_t state_version() const { return state_version_.load(); }

 private:
  /// A state without word and reason; mutex_ held.
  [[nodiscard]] State data_flow(const Facts& facts, MonotonicTime now,
                                std::optional<double> stale_after) const;
  /// Word and reason of the first state that holds; mutex_ held.
  [[nodiscard]] std::pair<std::string, std::string> judge(const Facts& facts, MonotonicTime now,
                                                          double budget, const std::string& silence) const;
  static constexpr double k_min_budget = 0.01;  ///< s, where it is derived from the period
  const project::ServeOptions& options_;
  bool strict_;
  mutable Pulses pulses_;
  mutable std::mutex mutex_;
  std::deque<MonotonicTime> accepted_at_;  ///< the last 32
  std::vector<MonotonicTime> awaited_;
  std::int64_t deadline_misses_ = 0;
  bool last_missed_ = false;
  std::atomic<bool> strict_miss_{false};
  std::atomic<std::int64_t> state_version_{0};
  State state_;
};

}  // namespace knothe::service
