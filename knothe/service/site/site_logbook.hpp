#pragma once
/// @file The logbook of a site as its readers see it.
#include <mutex>
#include <nlohmann/json.hpp>

#include "knothe/model/observe/sensors.hpp"
#include "knothe/service/journal/logbook.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {

/// As readers are told it.
[[nodiscard]] Json json_of(const LogbookEntry& entry);

/// Index of the sensor that a request names. RequestError 400 UnknownSensor, which lists those that there
/// are.
[[nodiscard]] std::int64_t sensor_of(const EntryRequest& request, const model::Sensors& sensors);

/// Thread-safe; its mutex is taken last.
class SiteLogbook {
 public:
  SiteLogbook(std::span<const double> model_times, const std::vector<LogbookEntry>& entries);
  void add(const LogbookEntry& entry);
  /// Those with a number > `number`, in order.
  [[nodiscard]] std::vector<LogbookEntry> after(std::int64_t number) const;
  [[nodiscard]] std::int64_t last_number() const;
  /// The entry that finished the test, if it is.
  [[nodiscard]] std::optional<LogbookEntry> finished() const;
  /// Sensors that are switched off at that step, increasing.
  [[nodiscard]] std::vector<std::int64_t> off_at(std::size_t step) const;

 private:
  mutable std::mutex mutex_;
  std::vector<LogbookEntry> entries_;
  SensorSwitches switches_;
  TestCourse course_;
};

}  // namespace knothe::service
