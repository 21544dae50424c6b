#include "knothe/service/site/pulses.hpp"

#include <fmt/format.h>

namespace knothe::service {

std::string Pulse::complaint(MonotonicTime now) const {
  const MonotonicTime::rep since = since_;
  if (since == k_resting) return "";
  const double seconds = seconds_between(MonotonicTime(MonotonicTime::duration(since)), now);
  return seconds > max_s_ ? fmt::format("{} has not moved on for {:.0f} s", who_, seconds) : "";
}

std::shared_ptr<Pulse> Pulses::add(std::string who, double max_s) {
  auto pulse = std::make_shared<Pulse>(std::move(who), max_s);
  const std::lock_guard lock(mutex_);
  std::erase_if(pulses_, [](const auto& one) { return one.expired(); });
  pulses_.push_back(pulse);
  return pulse;
}

std::string Pulses::complaint(MonotonicTime now) const {
  const std::lock_guard lock(mutex_);
  std::string all;
  for (const auto& one : pulses_) {
    const auto pulse = one.lock();
    const std::string said = pulse ? pulse->complaint(now) : "";
    if (!said.empty()) all += (all.empty() ? "" : "; ") + said;
  }
  return all;
}

}  // namespace knothe::service
