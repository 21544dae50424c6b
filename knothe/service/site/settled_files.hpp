#pragma once
/// @file Which files of a folder are finished: those that have not changed for a while. Works for files that
/// are renamed into place, for those that are written slowly, and on file systems that tell nobody of
/// changes.
#include <chrono>
#include <cstdint>
#include <ctime>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace knothe::service {

class SettledFiles {
 public:
  using Clock = std::chrono::steady_clock;
  /// Only names that are `wanted` count. A folder that is not there is empty.
  SettledFiles(std::string folder, double settle_s, std::function<bool(const std::string&)> wanted);

  /// Names (numbers in them by value) whose size and time of change have been the same for `settle_s`, and
  /// which are not done. Of whatever kind: a pipe or a link too is something that came.
  [[nodiscard]] std::vector<std::string> new_files(Clock::time_point now);
  /// The file is taken; it comes again only if it changes.
  void done(const std::string& name) { files_.at(name).done = true; }
  /// How long the file has not changed, s.
  [[nodiscard]] double rest(const std::string& name, Clock::time_point now) const;
  [[nodiscard]] std::string path(const std::string& name) const;
  [[nodiscard]] const std::string& folder() const { return folder_; }
  [[nodiscard]] bool wants(const std::string& name) const { return wanted_(name); }

 private:
  struct File {
    std::int64_t size = 0, changed_ns = 0;
    Clock::time_point since;
    bool done = false;
  };
  [[nodiscard]] bool may_skip(Clock::time_point now);
  void list(Clock::time_point now);

  std::string folder_;
  double settle_s_;
  std::function<bool(const std::string&)> wanted_;
  std::map<std::string, File> files_;
  std::int64_t folder_ns_ = -1;            ///< the folder's own time of change
  Clock::time_point folder_since_;         ///< when that was seen first
  Clock::time_point listed_at_, next_at_;  ///< the last look at all files, and before when there is no other
};

/// The names in a folder that are `wanted`; none where it cannot be read.
[[nodiscard]] std::vector<std::string> names_in(const std::string& folder,
                                                const std::function<bool(const std::string&)>& wanted);

}  // namespace knothe::service
