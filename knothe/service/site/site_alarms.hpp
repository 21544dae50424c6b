#pragma once
/// @file What people should know of a site, as it happens.
#include <atomic>
#include <deque>
#include <functional>
#include <mutex>

#include "knothe/service/journal/alarm.hpp"
#include "knothe/service/site/line.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {

/// As readers are told it.
[[nodiscard]] Json json_of(const Alarm& alarm);

/// The last alarms; where there are too many, the oldest of the most frequent kind goes: a loose plug does
/// not push out what the structure had to say. Thread-safe; its mutex is taken last but for the journal's.
class SiteAlarms {
 public:
  static constexpr std::size_t k_kept = 256;

  /// Ids are taken from `next_event`, which lines share. `store` is called for each alarm, and for the end of
  /// each condition.
  SiteAlarms(const std::vector<assimilation::ForecastSpecification>& forecasts,
             std::atomic<std::int64_t>& next_event, std::function<void(const Alarm&)> store)
      : forecasts_(forecasts), next_event_(next_event), store_(std::move(store)) {}

  /// What was told before a restart, and the last of each condition: nothing of it is told again.
  void restore(std::vector<Alarm> told, const std::vector<Alarm>& conditions);
  void raise(std::size_t step, const std::string& severity, const std::string& kind,
             const std::string& message);
  /// Raises what begins to hold, or holds with another severity; with an empty one it holds no more.
  void update_condition(const std::string& condition, std::size_t step, const std::string& severity,
                        const std::string& kind, const std::string& message);
  /// All conditions of a line. A threshold is no alarm while the line is not `informed`: its forecast is then
  /// the prior's.
  void update_conditions(const Line& line, bool informed = true);
  /// Marks an alarm as seen to; one that is no longer kept is left alone.
  void acknowledge(std::int64_t id, Acknowledgement acknowledgement);
  [[nodiscard]] std::optional<Alarm> find(std::int64_t id) const;
  /// How many warnings and alarms nobody has acknowledged.
  [[nodiscard]] std::size_t unacknowledged() const;
  /// Those that were raised or acknowledged by events > `id`, in the order of being raised.
  [[nodiscard]] std::vector<Alarm> after(std::int64_t id) const;
  /// The last event that told something of an alarm.
  [[nodiscard]] static std::int64_t last_event(const Alarm& alarm);

 private:
  void add(Alarm alarm);  ///< mutex_ held
  void drop_one();

  const std::vector<assimilation::ForecastSpecification>& forecasts_;
  std::atomic<std::int64_t>& next_event_;
  std::function<void(const Alarm&)> store_;
  mutable std::mutex mutex_;
  std::map<std::string, std::string> severities_;  ///< by condition
  std::deque<Alarm> alarms_;
};

}  // namespace knothe::service
