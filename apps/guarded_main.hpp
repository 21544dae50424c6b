#pragma once
/// @file What both programs do around a command: errors become a message and an exit status.
#include <cstdio>
#include <exception>
#include <functional>
#include <new>
#include <string_view>
#include <system_error>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"

namespace knothe {

/// Runs `command`; returns its exit status, or that of the Error it threw after printing the message to
/// stderr.
inline int guarded_main(const char* program, const std::function<int()>& command) {
  install_signal_handlers();
  try {
    const int status = command();
    // What was printed is on its way only now: a full disk behind stdout must not pass for success.
    if (std::fflush(stdout) != 0) throw system_error("could not write", "standard output");
    if (std::ferror(stdout) != 0) throw IoError("could not write all of standard output: is the disk full?");
    return status;
  } catch (const std::system_error& error) {
    std::fprintf(stderr, "%s: error: %s\n", program, error.what());
    return static_cast<int>(ExitStatus::io);
  } catch (const Error& error) {
    // Where a text file is to blame the message begins with file:line:column, for editors that jump there.
    const std::string_view words = error.what();
    const bool names_its_place = words.find(": error: ") != std::string_view::npos;
    const char* kind = error.status() == ExitStatus::interrupted ? ": " : ": error: ";
    std::fprintf(stderr, "%s%s%s\n", names_its_place ? "" : program, names_its_place ? "" : kind,
                 error.what());
    return static_cast<int>(error.status());
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "%s: error: out of memory\n", program);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: internal error: %s\n", program, error.what());
  }
  return static_cast<int>(ExitStatus::internal);
}

/// Of an answer: `done`, or `numerical` if it is not trusted.
inline int exit_status(bool trusted) {
  return static_cast<int>(trusted ? ExitStatus::done : ExitStatus::numerical);
}

}  // namespace knothe
