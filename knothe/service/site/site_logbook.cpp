#include "knothe/service/site/site_logbook.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/service/journal/verification.hpp"

namespace knothe::service {

Json json_of(const LogbookEntry& entry) {
  Json body = {{"number", entry.number}, {"kind", to_text(entry.kind)},
               {"time", entry.time},     {"by", entry.author},
               {"text", entry.text},     {"written_at", 1e-3 * entry.written_ms}};
  if (entry.kind == EntryKind::acknowledgement) body["alarm"] = entry.subject;
  if (entry.kind == EntryKind::sensor_off || entry.kind == EntryKind::sensor_on)
    body["sensor"] = entry.subject;
  if (entry.kind == EntryKind::released || entry.kind == EntryKind::withdrawn) body["record"] = entry.subject;
  if (const auto v = verification_of(entry)) {
    body["text"] = text_of(*v);
    body["version"] = v->version;
    body["full_order_runs"] = v->runs;
    body["moved_std"] = v->moved_std;
    body["model"] = v->model;
  }
  return body;
}

std::int64_t sensor_of(const EntryRequest& request, const model::Sensors& sensors) {
  const auto count = std::ssize(sensors.components) + std::ssize(sensors.scalars);
  if (request.sensor_index && *request.sensor_index < count) return *request.sensor_index;
  for (std::size_t i = 0; !request.sensor_name.empty() && i < sensors.scalars.size(); ++i)
    if (sensors.scalars[i] == request.sensor_name) return sensors.displacement_count() + i;
  std::string names;
  for (const std::string& name : sensors.scalars) names += fmt::format(", \"{}\"", name);
  throw RequestError(
      400, "UnknownSensor",
      fmt::format("\"sensor\" must name one of this site's sensors: 0 to {}{}", count - 1, names));
}

SiteLogbook::SiteLogbook(std::span<const double> model_times, const std::vector<LogbookEntry>& entries)
    : switches_(model_times) {
  for (const LogbookEntry& entry : entries) add(entry);
}

void SiteLogbook::add(const LogbookEntry& entry) {
  const std::lock_guard lock(mutex_);
  entries_.push_back(entry);
  switches_.add(entry);
  course_.add(entry);
}

std::optional<LogbookEntry> SiteLogbook::finished() const {
  const std::lock_guard lock(mutex_);
  return course_.end();
}

std::vector<LogbookEntry> SiteLogbook::after(std::int64_t number) const {
  const std::lock_guard lock(mutex_);
  const auto first = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const auto& entry) { return entry.number > number; });
  return {first, entries_.end()};
}

std::int64_t SiteLogbook::last_number() const {
  const std::lock_guard lock(mutex_);
  return entries_.empty() ? 0 : entries_.back().number;
}

std::vector<std::int64_t> SiteLogbook::off_at(std::size_t step) const {
  const std::lock_guard lock(mutex_);
  return switches_.off_at(step);
}

}  // namespace knothe::service
