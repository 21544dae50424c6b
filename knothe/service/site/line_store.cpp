#include "knothe/service/site/line_store.hpp"

namespace knothe::service {

void LineStore::publish(std::shared_ptr<const Line> line) {
  const std::lock_guard lock(mutex_);
  if (const auto it = event_of_.find(line->step); it != event_of_.end()) events_.erase(it->second);
  event_of_[line->step] = line->event;
  events_[line->event] = line;
  if (line->withdrawn) {
    lines_.erase(line->step);
    return;
  }
  const std::size_t step = line->step;
  lines_[step] = std::move(line);
}

std::shared_ptr<const Line> LineStore::latest() const {
  const std::lock_guard lock(mutex_);
  return lines_.empty() ? nullptr : lines_.rbegin()->second;
}

std::shared_ptr<const Line> LineStore::line(std::size_t step) const {
  const std::lock_guard lock(mutex_);
  const auto it = lines_.find(step);
  return it == lines_.end() ? nullptr : it->second;
}

std::vector<std::shared_ptr<const Line>> LineStore::lines(std::size_t from) const {
  const std::lock_guard lock(mutex_);
  std::vector<std::shared_ptr<const Line>> found;
  for (auto it = lines_.lower_bound(from); it != lines_.end(); ++it) found.push_back(it->second);
  return found;
}

std::shared_ptr<const Line> LineStore::next_line(std::int64_t event) const {
  const std::lock_guard lock(mutex_);
  const auto it = events_.upper_bound(event);
  return it == events_.end() ? nullptr : it->second;
}

std::int64_t LineStore::last_event() const {
  const std::lock_guard lock(mutex_);
  return events_.empty() ? 0 : events_.rbegin()->first;
}

}  // namespace knothe::service
