#pragma once
/// @file What may go wrong, and which exit status says so (docs/explanation/architecture.md, "Errors").
#include <stdexcept>
#include <string>

namespace knothe {

/// Exit status of the programs; outside programs rely on these numbers.
enum class ExitStatus {
  done = 0,
  internal = 1,   ///< our own fault, or a part that is not installed
  usage = 2,      ///< wrong command line
  project = 3,    ///< project file missing or invalid
  data = 4,       ///< model or data file missing or invalid, or an outside model's server failed
  io = 5,         ///< input/output error, disk full
  numerical = 6,  ///< a computation that could not be done
  deadline = 7,   ///< deadline missed under --strict-deadline
  rejected = 8,   ///< all steps processed, and the verdict on them is `reject`
  interrupted = 130
};

/// A mistake of the caller or in a file. The message says what is wrong, where, and what to do about it.
/// Numerical outcomes (not converged, tolerance missed) are not errors: they are in the result objects.
class Error : public std::runtime_error {
 public:
  Error(ExitStatus status, const std::string& message) : std::runtime_error(message), status_(status) {}
  [[nodiscard]] ExitStatus status() const noexcept { return status_; }

 private:
  ExitStatus status_;
};

struct UsageError : Error {
  explicit UsageError(const std::string& message) : Error(ExitStatus::usage, message) {}
};
struct ProjectError : Error {
  explicit ProjectError(const std::string& message) : Error(ExitStatus::project, message) {}
};
/// A model or data file: the message names file, data set and index.
struct DataError : Error {
  explicit DataError(const std::string& message) : Error(ExitStatus::data, message) {}
};
struct IoError : Error {
  explicit IoError(const std::string& message) : Error(ExitStatus::io, message) {}
};
struct NumericalError : Error {
  explicit NumericalError(const std::string& message) : Error(ExitStatus::numerical, message) {}
};
struct Interrupted : Error {
  explicit Interrupted(const std::string& message) : Error(ExitStatus::interrupted, message) {}
};

/// An IoError for the system call that has just failed: "`doing`: `path`: No space left on device".
[[nodiscard]] IoError system_error(const std::string& doing, const std::string& path);

}  // namespace knothe
