#include "knothe/service/site/alarm_sender.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "knothe/base/enum_names.hpp"
#include "knothe/service/site/site_alarms.hpp"

namespace knothe::service {
namespace {

using std::chrono::milliseconds;
constexpr milliseconds k_first_pause{1000}, k_longest_pause{60'000};

}  // namespace

Json message_of(const AlarmOrigin& origin, const Alarm& alarm, bool trial) {
  Json message = {{"site", origin.site}, {"test", trial}, {"alarm", json_of(alarm)}};
  if (!origin.test.empty()) message["test_name"] = origin.test;  // "test" was taken
  return message;
}

AlarmSender::AlarmSender(const project::Project& project, Metrics& metrics)
    : options_(project.serve), metrics_(metrics) {
  for (auto& channel : alarm_channels(project)) {
    routes_.push_back(std::make_unique<Route>());
    routes_.back()->channel = std::move(channel);
    for (const char* outcome : {"sent", "failed", "lost"}) count(*routes_.back(), outcome, 0);
    show_waiting(*routes_.back());
  }
  for (const auto& route : routes_) route->thread = std::thread([this, &route = *route] { run(route); });
}

AlarmSender::~AlarmSender() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  there_.notify_all();
  for (const auto& route : routes_) route->thread.join();
  for (const auto& route : routes_)
    if (!route->waiting.empty())
      log_event(
          "warning", "alarms were not sent: the service stopped",
          {{"site", options_.site}, {"channel", route->channel->name()}, {"alarms", route->waiting.size()}});
}

void AlarmSender::enqueue(const Alarm& alarm, const std::string& test) {
  const auto severity = from_text<project::Severity>(alarm.severity);
  if (!severity || *severity < options_.notify.severity) return;
  const Json message = message_of({options_.site, test}, alarm);
  {
    const std::lock_guard lock(mutex_);
    for (const auto& route : routes_) {
      route->waiting.push_back(message);
      if (route->waiting.size() > k_longest_queue) {
        route->waiting.pop_front();
        count(*route, "lost", 1);
      }
      show_waiting(*route);
    }
  }
  there_.notify_all();
}

void AlarmSender::run(Route& route) {
  milliseconds pause = k_first_pause;
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    there_.wait(lock, [&] { return stopping_ || !route.waiting.empty(); });
    if (stopping_) break;
    lock.unlock();
    const bool sent = send(route);
    lock.lock();
    there_.wait_for(lock, sent ? route.channel->rest() : pause, [&] { return stopping_.load(); });
    pause = sent ? k_first_pause : std::min(2 * pause, k_longest_pause);
  }
}

bool AlarmSender::send(Route& route) {
  std::vector<Json> messages;
  {
    const std::lock_guard lock(mutex_);
    messages.assign(route.waiting.begin(), route.waiting.end());
  }
  std::size_t sent = 0;
  try {
    sent = route.channel->send(messages, stopping_);
    log_event("info", "alarms were sent",
              {{"site", options_.site}, {"channel", route.channel->name()}, {"alarms", sent}});
    count(route, "sent", sent);
  } catch (const std::exception& error) {
    if (stopping_) return false;
    log_event("error", "an alarm could not be sent: sending is retried",
              {{"site", options_.site}, {"channel", route.channel->name()}, {"reason", error.what()}});
    count(route, "failed", 1);
    return false;
  }
  const std::lock_guard lock(mutex_);
  // The queue may have lost some of them at its front meanwhile.
  for (std::size_t k = 0; k < sent && !route.waiting.empty() && route.waiting.front() == messages[k]; ++k)
    route.waiting.pop_front();
  show_waiting(route);
  return true;
}

std::string AlarmSender::labels(const Route& route, const std::string& more) const {
  return site_labels(options_.site, fmt::format("channel=\"{}\"{}", route.channel->name(), more));
}

void AlarmSender::count(const Route& route, const char* outcome, std::size_t alarms) {
  metrics_.count("knothe_alarms_sent_total", labels(route, fmt::format(",outcome=\"{}\"", outcome)), alarms);
}

void AlarmSender::show_waiting(const Route& route) {
  metrics_.set("knothe_alarms_unsent", labels(route), route.waiting.size());
}

}  // namespace knothe::service
