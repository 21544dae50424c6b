#include "knothe/service/journal/logbook.hpp"

#include <algorithm>

#include "knothe/likelihood/data/time_matching.hpp"

namespace knothe::service {

void TestCourse::add(const LogbookEntry& entry) {
  using Kind = EntryKind;
  const bool begins = entry.kind == Kind::test_begun || entry.kind == Kind::test_resumed;
  const bool ends = entry.kind == Kind::test_finished || entry.kind == Kind::test_followed;
  if (!begins && !ends) return;
  if (entry.kind == Kind::test_begun) begun_ms_ = entry.written_ms;
  end_ = ends ? std::optional(entry) : std::nullopt;
}

std::optional<std::string> TestCourse::followed_by() const {
  return end_ && end_->kind == EntryKind::test_followed ? std::optional(end_->text) : std::nullopt;
}

void SensorSwitches::add(const LogbookEntry& entry) {
  if (entry.kind == EntryKind::sensor_off || entry.kind == EntryKind::sensor_on)
    switches_[entry.subject].push_back({first_step(entry.time), entry.kind == EntryKind::sensor_off});
}

std::size_t SensorSwitches::first_step(double time) const {
  if (const auto exact = likelihood::matching_time(time, model_times_)) return *exact;
  return std::lower_bound(model_times_.begin(), model_times_.end(), time) - model_times_.begin();
}

bool SensorSwitches::is_off(std::int64_t sensor, std::size_t step) const {
  const auto it = switches_.find(sensor);
  if (it == switches_.end()) return false;
  const auto last = std::find_if(it->second.rbegin(), it->second.rend(),
                                 [&](const Switch& one) { return one.from <= step; });
  return last != it->second.rend() && last->off;
}

std::vector<std::int64_t> SensorSwitches::off_at(std::size_t step) const {
  std::vector<std::int64_t> off;
  for (const auto& [sensor, history] : switches_)
    if (is_off(sensor, step)) off.push_back(sensor);
  return off;
}

Measurement SensorSwitches::seen(Measurement datum) const {
  for (const std::int64_t sensor : off_at(std::max<std::int64_t>(datum.step, 0)))
    if (sensor < std::ssize(datum.status)) datum.status[sensor] = 1;
  return datum;
}

}  // namespace knothe::service
