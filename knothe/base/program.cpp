#include "knothe/base/program.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <deque>
#include <filesystem>
#include <fstream>
#include <thread>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"

namespace knothe {
namespace {

/// Owns the two descriptions that posix_spawn wants.
class SpawnPlan {
 public:
  explicit SpawnPlan(const ProgramCall& call) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawnattr_init(&attributes_);
    const char* log = call.log.empty() ? "/dev/null" : call.log.c_str();
    posix_spawn_file_actions_addopen(&actions_, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions_, STDOUT_FILENO, log, O_WRONLY | O_CREAT | O_TRUNC, 0644);
    posix_spawn_file_actions_adddup2(&actions_, STDOUT_FILENO, STDERR_FILENO);
    if (!call.folder.empty()) posix_spawn_file_actions_addchdir_np(&actions_, call.folder.c_str());
    posix_spawnattr_setflags(&attributes_, POSIX_SPAWN_SETPGROUP);
    posix_spawnattr_setpgroup(&attributes_, 0);
  }
  ~SpawnPlan() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }
  SpawnPlan(const SpawnPlan&) = delete;
  SpawnPlan& operator=(const SpawnPlan&) = delete;

  [[nodiscard]] pid_t start(const std::vector<std::string>& words) {
    std::vector<char*> arguments;
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    pid_t process = -1;
    const int failed =
        posix_spawnp(&process, arguments[0], &actions_, &attributes_, arguments.data(), environ);
    if (failed == 0) return process;
    errno = failed;
    throw system_error("cannot run", words.front());
  }

 private:
  posix_spawn_file_actions_t actions_{};
  posix_spawnattr_t attributes_{};
};

constexpr double k_grace_s = 2;  // for a program that has to end others

/// The whole group, so that what a shell has started goes too. A program that has made groups of its own ends
/// them when it is asked to stop.
void end_group(pid_t process) {
  ::kill(-process, SIGTERM);
  const auto asked = monotonic_now();
  while (seconds_since(asked) < k_grace_s) {
    if (::waitpid(process, nullptr, WNOHANG) == process) {
      ::kill(-process, SIGKILL);
      return;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  ::kill(-process, SIGKILL);
  while (::waitpid(process, nullptr, 0) < 0 && errno == EINTR) {
  }
}

}  // namespace

ProgramEnd run_program(const ProgramCall& call) {
  if (call.words.empty()) throw UsageError("no program is given to run");
  const pid_t process = SpawnPlan(call).start(call.words);
  const auto start = monotonic_now();
  auto pause = std::chrono::microseconds(500);
  while (true) {
    int status = 0;
    const pid_t ended = ::waitpid(process, &status, WNOHANG);
    if (ended == process) {
      ::kill(-process, SIGKILL);  // whatever it has left behind
      return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), false};
    }
    if (call.time_limit_s > 0 && microseconds_since(start) > 1e6 * call.time_limit_s) {
      end_group(process);
      return {128 + SIGKILL, true};
    }
    if (cancellation_requested() || call.stop.stop_requested()) {
      end_group(process);
      throw Interrupted(fmt::format("interrupted while {} was running", call.words.front()));
    }
    std::this_thread::sleep_for(pause);
    pause = std::min(2 * pause, std::chrono::microseconds(20000));
  }
}

std::string program_beside(const std::string& name) {
  std::error_code failed;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", failed);
  const std::filesystem::path beside = self.parent_path() / name;
  return !failed && std::filesystem::exists(beside, failed) ? beside.string() : name;
}

std::string last_lines(const std::string& log, std::size_t lines) {
  std::ifstream file(log);
  std::deque<std::string> last;
  for (std::string line; std::getline(file, line);) {
    last.push_back(line);
    if (last.size() > lines) last.pop_front();
  }
  return fmt::format("{}", fmt::join(last, "\n"));
}

}  // namespace knothe
