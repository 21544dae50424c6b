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

/// What a folder holds now.
struct FolderContent {
  std::vector<std::string> names;  ///< those that are wanted
  std::string foreign;             ///< the first of those that are; empty: none
  std::string trouble;             ///< why it cannot be read; empty: it can
};
using NameTest = std::function<bool(const std::string&)>;
[[nodiscard]] FolderContent content_of(const std::string& folder, const NameTest& wanted,
                                       const NameTest& foreign);

class SettledFiles {
 public:
  using Clock = std::chrono::steady_clock;
  /// Only names that are `wanted` count. A folder that is not there is empty.
  SettledFiles(std::string folder, double settle_s, NameTest wanted, NameTest foreign);

  /// Names (numbers in them by value) whose size and time of change have been the same for `settle_s`, and
  /// which are not done. Of whatever kind: a pipe or a link too is something that came.
  [[nodiscard]] std::vector<std::string> new_files(Clock::time_point now);
  /// The file is taken; it comes again only if it changes.
  void done(const std::string& name) { files_.at(name).done = true; }
  /// How long the file has not changed, s.
  [[nodiscard]] double rest(const std::string& name, Clock::time_point now) const;
  [[nodiscard]] std::string path(const std::string& name) const;
  [[nodiscard]] const std::string& folder() const { return folder_; }
  /// As of the last look at the folder.
  [[nodiscard]] const std::string& foreign() const { return foreign_name_; }
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

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
  NameTest wanted_, foreign_;
  std::map<std::string, File> files_;
  std::string foreign_name_, trouble_;
  std::int64_t folder_ns_ = -1;            ///< the folder's own time of change
  Clock::time_point folder_since_;         ///< when that was seen first
  Clock::time_point listed_at_, next_at_;  ///< the last look at all files, and before when there is no other
};

}  // namespace knothe::service
