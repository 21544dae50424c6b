#pragma once
/// @file Which files of a folder are finished: those that have not changed for a while. Works for files that
/// are renamed into place, for those that are written slowly, and on file systems that tell nobody of
/// changes.
#include <chrono>
#include <cstdint>
#include <filesystem>
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
  /// which are not done.
  [[nodiscard]] std::vector<std::string> new_files(Clock::time_point now);
  /// The file is taken; it comes again only if it changes.
  void done(const std::string& name) { files_.at(name).done = true; }
  /// How long the file has not changed, s.
  [[nodiscard]] double rest(const std::string& name, Clock::time_point now) const;
  /// When it came, by the clock of the file system, Unix time: a copy that keeps the time of its original
  /// has come when it was made. For ever ahead for a file that has gone.
  [[nodiscard]] std::int64_t arrival_ms(const std::string& name) const;
  [[nodiscard]] std::string path(const std::string& name) const;
  [[nodiscard]] const std::string& folder() const { return folder_; }

 private:
  struct File {
    std::uintmax_t size = 0;
    std::filesystem::file_time_type changed;
    Clock::time_point since;
    bool done = false;
  };
  std::string folder_;
  double settle_s_;
  std::function<bool(const std::string&)> wanted_;
  std::map<std::string, File> files_;
};

}  // namespace knothe::service
