#include "knothe/service/site/settled_files.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "knothe/imaging/series/picture_folder.hpp"

namespace knothe::service {

SettledFiles::SettledFiles(std::string folder, double settle_s,
                           std::function<bool(const std::string&)> wanted)
    : folder_(std::move(folder)), settle_s_(settle_s), wanted_(std::move(wanted)) {}

std::vector<std::string> SettledFiles::new_files(Clock::time_point now) {
  std::error_code failure;
  std::map<std::string, File> found;
  std::vector<std::string> settled;
  for (auto it = std::filesystem::directory_iterator(folder_, failure);
       !failure && it != std::filesystem::directory_iterator(); it.increment(failure)) {
    const std::string name = it->path().filename().string();
    // A file that goes while it is looked at is not there.
    std::error_code gone;
    if (!wanted_(name) || !it->is_regular_file(gone)) continue;
    File file{it->file_size(gone), {}, now, false};
    if (!gone) file.changed = it->last_write_time(gone);
    if (gone) continue;
    const auto before = files_.find(name);
    if (before != files_.end() && before->second.size == file.size && before->second.changed == file.changed)
      file = before->second;
    if (!file.done && std::chrono::duration<double>(now - file.since).count() >= settle_s_)
      settled.push_back(name);
    found.emplace(name, file);
  }
  files_ = std::move(found);
  std::sort(settled.begin(), settled.end(), imaging::natural_less);
  return settled;
}

double SettledFiles::rest(const std::string& name, Clock::time_point now) const {
  return std::chrono::duration<double>(now - files_.at(name).since).count();
}

std::int64_t SettledFiles::arrival_ms(const std::string& name) const {
  struct stat found {};
  if (::stat(path(name).c_str(), &found) != 0) return std::numeric_limits<std::int64_t>::max() / 2;
  return 1000 * found.st_ctim.tv_sec + found.st_ctim.tv_nsec / 1'000'000;
}

std::string SettledFiles::path(const std::string& name) const {
  return (std::filesystem::path(folder_) / name).string();
}

}  // namespace knothe::service
