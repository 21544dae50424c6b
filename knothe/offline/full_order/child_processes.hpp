#pragma once
/// @file Jobs in processes of their own, some at a time.
#include <functional>
#include <string>

namespace knothe::offline {

/// How a job's process ended badly.
struct JobFailure {
  int job = 0;
  int exit_status = 0;  ///< base/error.hpp's, or 128 + the signal that killed it
  std::string message;  ///< what the process said, or by which signal it was killed
};

/// Runs `body(job)` for jobs 0 … count - 1, each in a forked child, at most `processes` at a time, in order.
/// `finished(done)` is called in the parent after each success. A job whose body throws, or whose process is
/// killed, stops the rest: running ones are ended, and `JobFailure` is thrown. When the user asks to stop,
/// running jobs are ended and Interrupted is thrown with `saved()`. Call it without threads running (fork).
void run_in_processes(int count, int processes, const std::function<void(int job)>& body,
                      const std::function<void(int done)>& finished,
                      const std::function<std::string()>& saved);

}  // namespace knothe::offline
