#pragma once
/// @file What people should know of a site, as it happens.
#include <atomic>
#include <deque>
#include <mutex>

#include "knothe/service/site/line.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {

struct Alarm {
  std::int64_t id = 0;
  std::size_t step = 0;
  std::string severity, kind, message;
  [[nodiscard]] Json json() const;
};

/// The last alarms. Thread-safe; its mutex is taken last.
class SiteAlarms {
 public:
  /// Ids are taken from `next_event`, which lines share.
  SiteAlarms(const std::vector<forecast::ForecastSpecification>& forecasts,
             std::atomic<std::int64_t>& next_event)
      : forecasts_(forecasts), next_event_(next_event) {}

  void raise(std::size_t step, const std::string& severity, const std::string& kind,
             const std::string& message);
  /// Raises what begins to hold with this line; not again while it holds. From one thread.
  void judge(const Line& line);
  /// Those with an id > `id`, in order.
  [[nodiscard]] std::vector<Alarm> after(std::int64_t id) const;

 private:
  static constexpr std::size_t k_kept = 256;
  const std::vector<forecast::ForecastSpecification>& forecasts_;
  std::atomic<std::int64_t>& next_event_;
  std::map<std::string, std::string> severities_;  ///< by condition; of the thread that judges
  mutable std::mutex mutex_;
  std::deque<Alarm> alarms_;
};

}  // namespace knothe::service
