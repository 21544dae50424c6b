#include "knothe/service/site/log.hpp"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <chrono>
#include <climits>
#include <mutex>
#include <nlohmann/json.hpp>

namespace knothe::service {
namespace {

constexpr std::size_t k_longest_line = PIPE_BUF;  // what a pipe that can be written takes without waiting
constexpr std::size_t k_longest_text = 300;       // of a member, where the line would be longer

std::string text_of(const Json& line) {
  return line.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string line_of(const std::string& level, const std::string& what, const Json& more) {
  const auto now = std::chrono::system_clock::now();
  const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()).count();
  Json line = {{"time", fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", fmt::gmtime((ms / 1000)), ms % 1000)},
               {"level", level},
               {"event", what}};
  const Json head = line;
  for (const auto& [key, value] : more.items()) line[key] = value;
  std::string text = text_of(line);
  if (text.size() <= k_longest_line) return text;
  for (auto& [key, value] : line.items())
    if (value.is_string()) value = value.get<std::string>().substr(0, k_longest_text);
  text = text_of(line);
  return text.size() <= k_longest_line ? text : text_of(head);
}

bool can_be_written() {
  pollfd out{STDERR_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0;
}

}  // namespace

void log_event(const std::string& level, const std::string& what, const Json& more) {
  static std::mutex k_mutex;
  static std::int64_t k_lost = 0;
  const std::string text = line_of(level, what, more);
  const std::lock_guard lock(k_mutex);
  const auto write = [](const std::string& line) {
    // Nobody waits for a reader of the log that does not read: its lines are lost, and counted.
    if (!can_be_written()) return false;
    return ::write(STDERR_FILENO, line.data(), line.size()) == std::ssize(line);
  };
  if (k_lost > 0 && write(line_of("warning", "lines of the log were lost", {{"lines", k_lost}}))) k_lost = 0;
  if (!write(text)) ++k_lost;
}

void end_log() {
  if (!can_be_written()) ::fcntl(STDERR_FILENO, F_SETFL, ::fcntl(STDERR_FILENO, F_GETFL) | O_NONBLOCK);
}

}  // namespace knothe::service
