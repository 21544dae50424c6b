#pragma once
/// @file Progress of long work, on stderr: a bar with the time left on a terminal, a line every 10 s
/// elsewhere.
#include <chrono>
#include <cstddef>
#include <string>

namespace knothe {

/// Shows how far some work is. Construct, `advance_to` as often as you like (it is cheap), and let it go out
/// of scope. Not thread-safe: report from one thread.
class Progress {
 public:
  /// `label` names the work, `total` is the number of its units; `quiet` shows nothing.
  Progress(std::string label, std::size_t total, bool quiet = false);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `done` units are finished; `detail` is a short remark beside the bar.
  void advance_to(std::size_t done, const std::string& detail = {});

 private:
  void show(const std::string& detail, bool last);

  using Clock = std::chrono::steady_clock;
  std::string label_;
  std::size_t total_;
  std::size_t done_ = 0;
  bool quiet_;
  bool terminal_;
  bool shown_ = false;
  Clock::time_point start_;
  Clock::time_point last_shown_;
};

}  // namespace knothe
