#include "knothe/offline/full_order/child_processes.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <vector>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"

namespace knothe::offline {
namespace {

struct Child {
  pid_t process = -1;
  int pipe = -1;  ///< its last words; end of file when it is gone
  int job = 0;
  std::string message;
};

void say(int pipe, const std::string& message) {
  std::size_t written = 0;
  while (written < message.size()) {
    const auto count = ::write(pipe, message.data() + written, message.size() - written);
    if (count <= 0) return;
    written += count;
  }
}

[[noreturn]] void run_child(int job, int pipe, pid_t parent, const std::function<void(int)>& body) {
  // If the parent is killed nobody would stop us.
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(1);
  int status = 1;
  try {
    body(job);
    status = 0;
  } catch (const Error& error) {
    say(pipe, error.what());
    status = static_cast<int>(error.status());
  } catch (const std::bad_alloc&) {
    say(pipe, "out of memory");
  } catch (const std::exception& error) {
    say(pipe, error.what());
  }
  // No destructors of the parent's objects, no flushing of its buffers.
  ::_exit(status);
}

class Pool {
 public:
  ~Pool() { end_all(); }

  void start(int job, const std::function<void(int)>& body) {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) throw system_error("cannot open a pipe to a new process", "pipe");
    std::fflush(nullptr);
    const pid_t parent = ::getpid();
    const pid_t process = ::fork();
    if (process < 0) {
      const IoError error = system_error("cannot start a process", "fork");
      ::close(ends[0]);
      ::close(ends[1]);
      throw error;
    }
    if (process == 0) {
      ::close(ends[0]);
      run_child(job, ends[1], parent, body);
    }
    ::close(ends[1]);
    children_.push_back({process, ends[0], job, {}});
  }

  [[nodiscard]] int running() const { return children_.size(); }

  /// Waits a moment for children to end and returns how many ended well.
  int collect() {
    std::vector<pollfd> polled;
    for (const auto& child : children_) polled.push_back({child.pipe, POLLIN, 0});
    if (::poll(polled.data(), polled.size(), 100) <= 0) return 0;
    int done = 0;
    for (std::size_t i = polled.size(); i-- > 0;) {
      if (polled[i].revents == 0) continue;
      char buffer[1024];
      const auto count = ::read(children_[i].pipe, buffer, sizeof buffer);
      if (count > 0) {
        children_[i].message.append(buffer, count);
        continue;
      }
      const Child child = children_[i];
      children_.erase(children_.begin() + i);
      const int status = bury(child);
      if (WIFEXITED(status) && WEXITSTATUS(status) == 0) {
        ++done;
      } else if (WIFEXITED(status)) {
        throw JobFailure{child.job, WEXITSTATUS(status), child.message};
      } else {
        const int signal = WTERMSIG(status);
        throw JobFailure{child.job, 128 + signal,
                         fmt::format("killed by signal {} ({})", signal, ::strsignal(signal))};
      }
    }
    return done;
  }

  void end_all() {
    for (const auto& child : children_) ::kill(child.process, SIGKILL);
    for (const auto& child : children_) bury(child);
    children_.clear();
  }

 private:
  static int bury(const Child& child) {
    ::close(child.pipe);
    int status = 0;
    while (::waitpid(child.process, &status, 0) < 0 && errno == EINTR) {
    }
    return status;
  }

  std::vector<Child> children_;
};

}  // namespace

void run_in_processes(int count, int processes, const std::function<void(int)>& body,
                      const std::function<void(int)>& finished, const std::function<std::string()>& saved) {
  Pool pool;
  int started = 0, done = 0;
  while (done < count) {
    while (started < count && pool.running() < std::max(processes, 1) && !cancellation_requested())
      pool.start(started++, body);
    if (cancellation_requested()) {
      pool.end_all();
      throw Interrupted("interrupted; " + saved());
    }
    const int ended = pool.collect();
    done += ended;
    if (ended > 0) finished(done);
  }
}

}  // namespace knothe::offline
