#pragma once
/// @file One thread that does things one after the other, so that the thread of HTTP does not have to.
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>

namespace knothe::service {

class Worker {
 public:
  Worker() : thread_([this] { run(); }) {}
  /// Does what was asked for, then ends.
  ~Worker() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    there_.notify_one();
    thread_.join();
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// False if too much is waiting: it will not be done.
  [[nodiscard]] bool post(std::function<void()> task) {
    const std::lock_guard lock(mutex_);
    if (tasks_.size() >= 1024) return false;
    tasks_.push_back(std::move(task));
    there_.notify_one();
    return true;
  }

 private:
  void run() {
    while (true) {
      std::function<void()> task;
      {
        std::unique_lock lock(mutex_);
        there_.wait(lock, [&] { return stopping_ || !tasks_.empty(); });
        if (tasks_.empty()) return;
        task = std::move(tasks_.front());
        tasks_.pop_front();
      }
      task();
    }
  }

  std::mutex mutex_;
  std::condition_variable there_;
  std::deque<std::function<void()>> tasks_;
  bool stopping_ = false;
  std::thread thread_;  // last: it uses the others
};

}  // namespace knothe::service
