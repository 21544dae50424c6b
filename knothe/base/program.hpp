#pragma once
/// @file Other programs, run and waited for.
#include <stop_token>
#include <string>
#include <vector>

namespace knothe {

/// What to run, and how.
struct ProgramCall {
  std::vector<std::string> words;  ///< program (a path, or a name on the PATH) and its arguments
  std::string folder;              ///< to run in; empty: the present one
  std::string log;                 ///< file for its stdout and stderr, replaced; empty: they are dropped
  double time_limit_s = 0;         ///< after which it and its children are ended; 0: none
  std::stop_token stop;            ///< ends it too
};

/// How it ended.
struct ProgramEnd {
  int status = 0;  ///< exit status, or 128 + the signal that ended it
  bool timed_out = false;
};

/// Runs a program in a process group of its own, with no input, and waits for it. Safe from several threads.
/// IoError if it cannot be started; Interrupted when the user or `stop` asks to stop: it is ended then,
/// by SIGTERM, and where that does not help by SIGKILL.
[[nodiscard]] ProgramEnd run_program(const ProgramCall& call);

/// The program of that name beside this one, or else `name` itself, to be found on the PATH.
[[nodiscard]] std::string program_beside(const std::string& name);

/// The last lines of a log, for a message; empty if there is none.
[[nodiscard]] std::string last_lines(const std::string& log, std::size_t lines = 5);

}  // namespace knothe
