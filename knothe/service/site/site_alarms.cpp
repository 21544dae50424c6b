#include "knothe/service/site/site_alarms.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace knothe::service {

Json Alarm::json() const {
  return {{"id", id}, {"step", step}, {"severity", severity}, {"kind", kind}, {"message", message}};
}

void SiteAlarms::raise(std::size_t step, const std::string& severity, const std::string& kind,
                       const std::string& message) {
  const std::lock_guard lock(mutex_);
  alarms_.push_back({next_event_++, step, severity, kind, message});
  if (alarms_.size() > k_kept) alarms_.pop_front();
}

void SiteAlarms::judge(const Line& line) {
  const auto judge = [&](const std::string& condition, const std::string& severity, const std::string& kind,
                         const std::string& message) {
    std::string& before = severities_[condition];
    if (before != severity && !severity.empty()) raise(line.step, severity, kind, message);
    before = severity;
  };
  for (const forecast::ForecastSpecification& specification : forecasts_) {
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
  judge("bias", line.is_biased() ? "alarm" : "", "bias",
        fmt::format("the datum does not fit the model: χ² {:.4g} with {} values", line.misfit,
                    line.misfit_values));
  judge("monitor", line.monitor_alarm ? "alarm" : "", "bias",
        line.notice.empty() ? "the model does not explain the data" : line.notice);
  judge("correction", line.bias_corrected ? "info" : "", "bias", "the model's bias is corrected from now on");
  using Level = assimilation::VerdictLevel;
  judge("verdict",
        line.verdict == Level::reject    ? "alarm"
        : line.verdict == Level::caution ? "warning"
                                         : "",
        "verdict", line.verdict_message);
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

std::vector<Alarm> SiteAlarms::after(std::int64_t id) const {
  const std::lock_guard lock(mutex_);
  std::vector<Alarm> found;
  for (const Alarm& alarm : alarms_)
    if (alarm.id > id) found.push_back(alarm);
  return found;
}

}  // namespace knothe::service
