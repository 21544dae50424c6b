#include "knothe/service/site/site_alarms.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <string_view>

#include "knothe/assimilation/forecast/forecast_inputs.hpp"
#include "knothe/record/forecast_text.hpp"

namespace knothe::service {

Json json_of(const Alarm& alarm) {
  Json json = {{"id", alarm.id},     {"step", alarm.step},       {"severity", alarm.severity},
               {"kind", alarm.kind}, {"message", alarm.message}, {"raised_at", 1e-3 * alarm.raised_ms}};
  if (const auto& acknowledged = alarm.acknowledged)
    json["acknowledged"] = {
        {"by", acknowledged->by}, {"comment", acknowledged->comment}, {"at", 1e-3 * acknowledged->at_ms}};
  return json;
}

void SiteAlarms::restore(std::vector<Alarm> told, const std::vector<Alarm>& conditions) {
  const std::lock_guard lock(mutex_);
  alarms_.assign(std::make_move_iterator(told.begin()), std::make_move_iterator(told.end()));
  while (alarms_.size() > k_kept) drop_one();
  for (const Alarm& alarm : conditions) severities_[alarm.condition] = alarm.severity;
}

void SiteAlarms::drop_one() {
  std::map<std::string_view, std::size_t> count;
  for (const Alarm& alarm : alarms_) ++count[alarm.kind];
  const auto most = std::max_element(count.begin(), count.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  alarms_.erase(std::find_if(alarms_.begin(), alarms_.end(),
                             [&](const Alarm& alarm) { return alarm.kind == most->first; }));
}

void SiteAlarms::add(Alarm alarm) {
  alarm.id = next_event_++;
  alarm.raised_ms = std::chrono::duration_cast<std::chrono::milliseconds>(
                        std::chrono::system_clock::now().time_since_epoch())
                        .count();
  store_(alarm);
  if (alarm.severity.empty()) return;
  alarms_.push_back(std::move(alarm));
  if (alarms_.size() > k_kept) drop_one();
}

void SiteAlarms::raise(std::size_t step, const std::string& severity, const std::string& kind,
                       const std::string& message) {
  const std::lock_guard lock(mutex_);
  add({0, static_cast<std::int64_t>(step), severity, kind, message, "", 0, std::nullopt});
}

void SiteAlarms::update_condition(const std::string& condition, std::size_t step, const std::string& severity,
                                  const std::string& kind, const std::string& message) {
  const std::lock_guard lock(mutex_);
  std::string& before = severities_[condition];
  if (before == severity) return;
  before = severity;
  add({0, static_cast<std::int64_t>(step), severity, kind, message, condition, 0, std::nullopt});
}

void SiteAlarms::update_conditions(const Line& line, bool informed) {
  const auto update = [&](const std::string& condition, const std::string& severity, const std::string& kind,
                          const std::string& message) {
    update_condition(condition, line.step, severity, kind, message);
  };
  for (const assimilation::ForecastSpecification& specification : forecasts_) {
    const auto it = line.above_threshold.find(specification.name);
    if (it == line.above_threshold.end() || !specification.threshold || !informed) continue;
    const double p = it->second;
    const std::string units =
        line.model ? assimilation::forecast_units(line.model->setup.model.contents(), specification) : "";
    update("threshold " + specification.name,
           p >= 0.5    ? "alarm"
           : p >= 0.05 ? "warning"
                       : "",
           "threshold",
           fmt::format("P({} > {}) is {}", specification.name,
                       record::given_text(*specification.threshold, units), record::probability_text(p)));
  }
  update("bias", line.is_biased() ? "alarm" : "", "bias", line.misfit_message);
  update("monitor", line.monitor_alarm ? "alarm" : "", "bias",
         line.notice.empty() ? "the model does not explain the data" : line.notice);
  update("correction", line.bias_corrected ? "info" : "", "bias",
         "the model's bias is corrected from now on");
  using Level = assimilation::VerdictLevel;
  update("verdict",
         line.verdict == Level::reject    ? "alarm"
         : line.verdict == Level::caution ? "warning"
                                          : "",
         "verdict", line.verdict_message);
  update("trust", line.trusted ? "" : "info", "trust", line.remark);
  const auto missing = std::count(line.missing.begin(), line.missing.end(), true);
  update("sensors", 10 * missing > std::ssize(line.missing) ? "warning" : "", "sensors",
         fmt::format("{} of {} sensors are missing", missing, line.missing.size()));
  update("stuck", line.stuck.empty() ? "" : "warning", "sensors",
         fmt::format("the same value at five steps while the model moves: sensors {}",
                     fmt::join(line.stuck, ", ")));
  update("absent", line.absent.empty() ? "" : "warning", "sensors",
         fmt::format("no value at five steps: sensors {}", fmt::join(line.absent, ", ")));
}

std::vector<Alarm> SiteAlarms::after(std::int64_t id) const {
  const std::lock_guard lock(mutex_);
  std::vector<Alarm> found;
  for (const Alarm& alarm : alarms_)
    if (last_event(alarm) > id) found.push_back(alarm);
  return found;
}

std::int64_t SiteAlarms::last_event(const Alarm& alarm) {
  return alarm.acknowledged ? std::max(alarm.id, alarm.acknowledged->event) : alarm.id;
}

void SiteAlarms::acknowledge(std::int64_t id, Acknowledgement acknowledgement) {
  const std::lock_guard lock(mutex_);
  acknowledgement.event = next_event_++;
  for (Alarm& alarm : alarms_)
    if (alarm.id == id) alarm.acknowledged = acknowledgement;
}

std::optional<Alarm> SiteAlarms::find(std::int64_t id) const {
  const std::lock_guard lock(mutex_);
  const auto it = std::find_if(alarms_.begin(), alarms_.end(), [&](const Alarm& a) { return a.id == id; });
  return it == alarms_.end() ? std::nullopt : std::optional(*it);
}

std::size_t SiteAlarms::unacknowledged() const {
  const std::lock_guard lock(mutex_);
  return std::count_if(alarms_.begin(), alarms_.end(),
                       [](const Alarm& alarm) { return alarm.severity != "info" && !alarm.acknowledged; });
}

}  // namespace knothe::service
