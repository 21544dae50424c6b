#include "knothe/service/site/log.hpp"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <climits>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

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

/// Warnings and errors of one kind: so many at once, then so many a second. What is left out is counted, and
/// told with the next line of its kind that is written, or at the end.
constexpr double k_burst = 100, k_rate = 1;
struct Kind {
  double left = k_burst;
  std::chrono::steady_clock::time_point at = std::chrono::steady_clock::now();
  std::int64_t left_out = 0;
};

bool has_its_turn(Kind& kind) {
  const auto now = std::chrono::steady_clock::now();
  kind.left = std::min(k_burst, kind.left + k_rate * std::chrono::duration<double>(now - kind.at).count());
  kind.at = now;
  if (kind.left < 1) return false;
  kind.left -= 1;
  return true;
}

std::mutex& log_mutex() {
  static std::mutex k_mutex;
  return k_mutex;
}
std::map<std::string, Kind>& kinds() {
  static std::map<std::string, Kind> k_kinds;  // there are as many as the program has messages
  return k_kinds;
}

bool can_be_written() {
  pollfd out{STDERR_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0;
}

/// Nobody waits for a reader of the log that does not read: its lines are lost, and counted.
bool write(const std::string& line) {
  return can_be_written() && ::write(STDERR_FILENO, line.data(), line.size()) == std::ssize(line);
}

}  // namespace

void log_event(const std::string& level, const std::string& what, const Json& more) {
  static std::int64_t k_lost = 0;
  const std::lock_guard lock(log_mutex());
  Json members = more;
  if (level != "info") {
    Kind& kind = kinds()[what];
    if (!has_its_turn(kind)) {
      ++kind.left_out;
      return;
    }
    if (kind.left_out > 0) members["left_out_before"] = std::exchange(kind.left_out, 0);
  }
  const std::string text = line_of(level, what, members);
  if (k_lost > 0 && write(line_of("warning", "lines of the log were lost", {{"lines", k_lost}}))) k_lost = 0;
  if (!write(text)) ++k_lost;
}

void end_log() {
  {
    const std::lock_guard lock(log_mutex());
    for (auto& [what, kind] : kinds())
      if (const auto count = std::exchange(kind.left_out, 0); count > 0)
        (void)write(line_of("warning", "lines of one kind were left out", {{"of", what}, {"lines", count}}));
  }
  if (!can_be_written()) ::fcntl(STDERR_FILENO, F_SETFL, ::fcntl(STDERR_FILENO, F_GETFL) | O_NONBLOCK);
}

}  // namespace knothe::service
