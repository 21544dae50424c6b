#pragma once
/// @file Whether the threads of a site are alive: each says when it begins a piece of work, and when it
/// waits.
#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "knothe/base/monotonic_time.hpp"

namespace knothe::service {

/// Of one thread.
class Pulse {
 public:
  Pulse(std::string who, double max_s) : who_(std::move(who)), max_s_(max_s) {}
  /// The next piece of work begins.
  void beat(MonotonicTime now = monotonic_now()) { since_ = now.time_since_epoch().count(); }
  /// There is none: it may wait as long as it likes.
  void rest() { since_ = k_resting; }
  /// What is wrong, in words; empty: nothing.
  [[nodiscard]] std::string complaint(MonotonicTime now) const;

 private:
  static constexpr MonotonicTime::rep k_resting = 0;
  std::string who_;
  double max_s_;
  std::atomic<MonotonicTime::rep> since_{k_resting};
};

/// Thread-safe; its mutex is taken last.
class Pulses {
 public:
  /// Of a thread that takes at most `max_s` for a piece of work. It counts for as long as it is held.
  [[nodiscard]] std::shared_ptr<Pulse> add(std::string who, double max_s);
  /// Which threads have been at one piece of work for longer, in words; empty: none.
  [[nodiscard]] std::string complaint(MonotonicTime now = monotonic_now()) const;

 private:
  mutable std::mutex mutex_;
  std::vector<std::weak_ptr<Pulse>> pulses_;
};

}  // namespace knothe::service
