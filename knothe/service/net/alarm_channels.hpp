#pragma once
/// @file Where alarms are sent: a webhook, a topic of the MQTT broker, mail ([serve.notify]).
#include <atomic>
#include <chrono>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "knothe/project/project_file.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {

/// Used from one thread.
class AlarmChannel {
 public:
  virtual ~AlarmChannel() = default;
  [[nodiscard]] virtual std::string name() const = 0;
  /// Sends the first or more of `alarms` (not empty), each as `message_of` makes it: how many. Waits for
  /// the other side's word, at most some 10 s, and less where `stopping`. DataError, IoError: none was sent,
  /// and why.
  virtual std::size_t send(std::span<const Json> alarms, const std::atomic<bool>& stopping) = 0;
  /// Time between two messages at least: what comes meanwhile is sent together.
  [[nodiscard]] virtual std::chrono::milliseconds rest() const { return std::chrono::milliseconds(0); }
};

/// Those that the project names. ProjectError for an address that cannot be used.
[[nodiscard]] std::vector<std::unique_ptr<AlarmChannel>> alarm_channels(const project::Project& project);

}  // namespace knothe::service
