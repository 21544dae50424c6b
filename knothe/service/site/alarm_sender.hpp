#pragma once
/// @file Alarms on their way out. Nothing waits for them but the threads here.
#include <atomic>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "knothe/project/serve_options.hpp"
#include "knothe/service/journal/alarm.hpp"
#include "knothe/service/net/alarm_channels.hpp"
#include "knothe/service/site/metrics.hpp"

namespace knothe::service {

/// Of which site and test (name; empty: the one without) an alarm is.
struct AlarmOrigin {
  std::string site, test;
};
/// What a channel sends of an alarm; `trial`: to see whether it arrives.
[[nodiscard]] Json message_of(const AlarmOrigin& origin, const Alarm& alarm, bool trial = false);

/// One thread for each channel, so that one that is away holds up no other. What cannot be sent is tried
/// again, after 1 s at first and then twice as long each time, up to a minute. `enqueue` is thread-safe.
class AlarmSender {
 public:
  static constexpr std::size_t k_longest_queue = 256;  ///< then the oldest is lost, and that is said

  AlarmSender(const project::Project& project, Metrics& metrics);
  ~AlarmSender();  ///< What is not sent by then is lost, and that is said.
  AlarmSender(const AlarmSender&) = delete;
  AlarmSender& operator=(const AlarmSender&) = delete;

  /// For the channels, if it is severe enough; `test`: name of the one that it is of.
  void enqueue(const Alarm& alarm, const std::string& test);

 private:
  struct Route {
    std::unique_ptr<AlarmChannel> channel;
    std::deque<Json> waiting;
    std::thread thread;
  };
  void run(Route& route);
  /// Sends what it can; false: it is to be tried again.
  bool send(Route& route);
  void count(const Route& route, const char* outcome, std::size_t alarms);
  void show_waiting(const Route& route);  ///< mutex_ held
  [[nodiscard]] std::string labels(const Route& route, const std::string& more = "") const;

  const project::ServeOptions& options_;
  Metrics& metrics_;
  std::mutex mutex_;  ///< of `waiting`
  std::condition_variable there_;
  std::atomic<bool> stopping_{false};
  std::vector<std::unique_ptr<Route>> routes_;
};

}  // namespace knothe::service
