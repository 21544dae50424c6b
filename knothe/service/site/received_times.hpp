#pragma once
/// @file When data arrived.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace knothe::service {

/// Unix times in ms, by step; 16 bytes each.
class ReceivedTimes {
 public:
  void add(std::size_t step, std::int64_t ms) {
    const Entry entry(step, ms);
    entries_.insert(std::upper_bound(entries_.begin(), entries_.end(), entry), entry);
  }
  /// One that was added.
  void remove(std::size_t step, std::int64_t ms) {
    entries_.erase(std::lower_bound(entries_.begin(), entries_.end(), Entry(step, ms)));
  }
  /// Of the last datum of a step that has one.
  [[nodiscard]] std::int64_t last(std::size_t step) const {
    return std::prev(std::lower_bound(entries_.begin(), entries_.end(), Entry(step + 1, INT64_MIN)))->second;
  }

 private:
  using Entry = std::pair<std::size_t, std::int64_t>;
  std::vector<Entry> entries_;
};

}  // namespace knothe::service
