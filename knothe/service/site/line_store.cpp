#include "knothe/service/site/line_store.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <nlohmann/json.hpp>

#include "knothe/service/site/line_archive.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {
void LineStore::publish(std::shared_ptr<const Line> line) {
  const std::lock_guard lock(mutex_);
  const std::size_t step = line->step;
  Entry& entry = insert(step);
  entry.event = line->event, entry.withdrawn = line->withdrawn;
  if (line->withdrawn || line->trusted) {
    untrusted_.erase(step);
  } else {
    untrusted_.insert(step);
  }
  events_.emplace_back(line->event, step);
  published_.emplace_back(line->event, step);
  recent_[step] = line;
  if (line->withdrawn) {
    if (latest_ && latest_->step == step) set_latest();
  } else if (!latest_ || latest_->step <= step) {
    latest_ = std::move(line);
  }
  while (published_.size() > k_in_memory && file_oldest()) continue;
  drop_replaced_events();
}

std::vector<LineStore::Entry>::const_iterator LineStore::first_from(std::size_t step) const {
  return std::lower_bound(entries_.begin(), entries_.end(), step,
                          [](const Entry& entry, std::size_t s) { return entry.step < s; });
}

const LineStore::Entry* LineStore::find(std::size_t step) const {
  const auto it = first_from(step);
  return it == entries_.end() || it->step != step ? nullptr : &*it;
}

LineStore::Entry& LineStore::insert(std::size_t step) {
  auto it = entries_.begin() + (first_from(step) - entries_.cbegin());
  if (it == entries_.end() || it->step != step) {
    it = entries_.emplace(it);
    it->step = step;
  }
  return *it;
}

void LineStore::set_latest() {
  const auto last =
      std::find_if(entries_.rbegin(), entries_.rend(), [](const auto& e) { return !e.withdrawn; });
  latest_ = last == entries_.rend() ? nullptr : get(*last);
}

/// Those that were replaced are half of all at most: an event costs the same however many there were.
void LineStore::drop_replaced_events() {
  if (events_.size() <= 2 * entries_.size() + k_in_memory) return;
  std::erase_if(events_, [&](const auto& event) { return find(event.second)->event != event.first; });
}

/// The line that was published first of those in memory goes to the file. False where that cannot be.
bool LineStore::file_oldest() {
  const auto [event, step] = published_.front();
  Entry& entry = insert(step);
  if (entry.event == event) {
    if (!write(*recent_.at(step), entry)) {
      if (!std::exchange(told_, true))
        log_event("warning", "old lines stay in memory: the file for them cannot be written",
                  {{"folder", file_.folder()}, {"reason", std::strerror(errno)}});
      return false;
    }
    told_ = false;
    recent_.erase(step);
  }
  published_.pop_front();
  return true;
}

/// In the place of the line before of its step, where it fits.
bool LineStore::write(const Line& line, Entry& entry) {
  const std::string bytes = bytes_of(line);
  const bool fits = bytes.size() <= entry.capacity;
  const std::int64_t offset = fits ? entry.offset : end_;
  if (!file_.write(bytes, offset)) return false;
  entry.offset = offset, entry.size = bytes.size();
  if (!fits) {
    entry.capacity = bytes.size() + bytes.size() / 4;  // a few times at most it does not
    end_ += entry.capacity;
  }
  if (models_.empty() || models_.back() != line.model) {
    const auto known = std::find(models_.begin(), models_.end(), line.model);
    entry.model = known - models_.begin();
    if (known == models_.end()) models_.push_back(line.model);
  } else {
    entry.model = models_.size() - 1;
  }
  return true;
}

/// Null where the file cannot be read: its disk has failed.
std::shared_ptr<const Line> LineStore::get(const Entry& entry) const {
  if (const auto it = recent_.find(entry.step); it != recent_.end()) return it->second;
  const auto bytes = file_.read(entry.offset, entry.size);
  if (!bytes) {
    log_event("error", "an old line cannot be read",
              {{"folder", file_.folder()}, {"step", entry.step}, {"reason", std::strerror(errno)}});
    return nullptr;
  }
  auto line = line_of_bytes(*bytes);
  line->model = models_[entry.model];
  return line;
}

std::shared_ptr<const Line> LineStore::latest() const {
  const std::lock_guard lock(mutex_);
  return latest_;
}

std::shared_ptr<const Line> LineStore::line(std::size_t step) const {
  const std::lock_guard lock(mutex_);
  const Entry* entry = find(step);
  return entry == nullptr || entry->withdrawn ? nullptr : get(*entry);
}

std::shared_ptr<const Line> LineStore::line_from(std::size_t from) const {
  const std::lock_guard lock(mutex_);
  for (auto it = first_from(from); it != entries_.end(); ++it)
    if (it->withdrawn) {
      continue;
    } else if (auto line = get(*it)) {
      return line;
    }
  return nullptr;
}

std::vector<std::pair<std::int64_t, std::size_t>> LineStore::events_from(std::size_t from) const {
  const std::lock_guard lock(mutex_);
  std::vector<std::pair<std::int64_t, std::size_t>> found;
  for (auto it = first_from(from); it != entries_.end(); ++it)
    if (!it->withdrawn) found.emplace_back(it->event, it->step);
  return found;
}

std::shared_ptr<const Line> LineStore::next_line(std::int64_t event) const {
  const std::lock_guard lock(mutex_);
  auto it = std::upper_bound(events_.begin(), events_.end(), event,
                             [](std::int64_t e, const auto& one) { return e < one.first; });
  for (; it != events_.end(); ++it) {
    const Entry& entry = *find(it->second);
    if (entry.event != it->first) continue;
    if (auto line = get(entry)) return line;
  }
  return nullptr;
}

std::int64_t LineStore::last_event() const {
  const std::lock_guard lock(mutex_);
  return events_.empty() ? 0 : events_.back().first;
}

std::vector<std::size_t> LineStore::untrusted() const {
  const std::lock_guard lock(mutex_);
  const auto count = std::min(untrusted_.size(), k_untrusted);
  return {std::prev(untrusted_.end(), count), untrusted_.end()};
}

std::size_t LineStore::in_memory() const {
  const std::lock_guard lock(mutex_);
  return recent_.size();
}

}  // namespace knothe::service
