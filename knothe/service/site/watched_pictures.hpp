#pragma once
/// @file Which file of a watched folder a step was measured in.
#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace knothe::service {

/// Thread-safe; its mutex is taken last.
class WatchedPictures {
 public:
  explicit WatchedPictures(const std::vector<double>& times) : times_(times) {}  ///< the model's, by step

  /// The file that the datum of this model time was measured in.
  void show(double time, std::string file) {
    const auto nearest = std::min_element(times_.begin(), times_.end(), [&](double a, double b) {
      return std::abs(a - time) < std::abs(b - time);
    });
    if (nearest == times_.end()) return;
    const std::lock_guard lock(mutex_);
    files_[nearest - times_.begin()] = std::move(file);
  }
  /// Of that step; empty if there is none.
  [[nodiscard]] std::string of(std::size_t step) const {
    const std::lock_guard lock(mutex_);
    const auto it = files_.find(step);
    return it == files_.end() ? "" : it->second;
  }

 private:
  const std::vector<double>& times_;
  mutable std::mutex mutex_;
  std::map<std::size_t, std::string> files_;
};

}  // namespace knothe::service
