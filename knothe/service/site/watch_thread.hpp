#pragma once
/// @file A thread that looks at something from time to time.
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "knothe/service/site/pulses.hpp"

namespace knothe::service {

/// The last member of who has it: it ends first.
class WatchThread {
 public:
  WatchThread() = default;
  ~WatchThread() {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    end_.notify_all();
    if (thread_.joinable()) thread_.join();
  }
  WatchThread(const WatchThread&) = delete;
  WatchThread& operator=(const WatchThread&) = delete;

  /// `run` ends when `wait` says so.
  void begin(std::shared_ptr<Pulse> pulse, std::function<void()> run) {
    pulse_ = std::move(pulse);
    thread_ = std::thread(std::move(run));
  }
  // Of its thread alone: who waits for others is alive.
  void beat() { pulse_->beat(); }
  /// False when it is time to end.
  bool wait(double seconds) {
    beat();
    std::unique_lock lock(mutex_);
    return !end_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return ending_; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable end_;
  bool ending_ = false;
  std::shared_ptr<Pulse> pulse_;
  std::thread thread_;
};

}  // namespace knothe::service
