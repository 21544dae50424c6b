#include "knothe/service/site/settled_files.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "knothe/imaging/series/picture_folder.hpp"

namespace knothe::service {
namespace {

/// A folder's time of change may stand still for so long (FAT) while files come.
constexpr std::chrono::seconds k_coarsest_clock{2};
/// Files that are done, and folders whose time of change has not moved, are looked at all the same, as often
/// as that takes at most one part in so many of the time.
constexpr int k_share_of_time = 100, k_share_while_files_come = 10;
constexpr std::chrono::seconds k_quiet{1};

std::int64_t ns_of(const timespec& time) {
  return std::int64_t{1'000'000'000} * time.tv_sec + time.tv_nsec;
}

}  // namespace

FolderContent content_of(const std::string& folder, const NameTest& wanted, const NameTest& foreign) {
  FolderContent content;
  std::error_code failure;
  for (auto it = std::filesystem::directory_iterator(folder, failure);
       !failure && it != std::filesystem::directory_iterator(); it.increment(failure)) {
    std::string name = it->path().filename().string();
    if (wanted(name))
      content.names.push_back(std::move(name));
    else if (foreign(name) && (content.foreign.empty() || name < content.foreign))
      content.foreign = std::move(name);
  }
  if (failure) content.trouble = failure.message();
  return content;
}

SettledFiles::SettledFiles(std::string folder, double settle_s, NameTest wanted, NameTest foreign)
    : folder_(std::move(folder)),
      settle_s_(settle_s),
      wanted_(std::move(wanted)),
      foreign_(std::move(foreign)) {}

/// Whether nothing can have come since the last look: the folder is as it was, and no file is waited for. So
/// many files, of whatever name, cost nothing while nothing comes.
bool SettledFiles::may_skip(Clock::time_point now) {
  struct stat found {};
  const std::int64_t changed = ::stat(folder_.c_str(), &found) == 0 ? ns_of(found.st_mtim) : -1;
  if (changed != folder_ns_) folder_since_ = now;
  const bool same = std::exchange(folder_ns_, changed) == changed;
  if (now < next_at_) return true;
  const bool waits = std::any_of(files_.begin(), files_.end(), [](const auto& f) { return !f.second.done; });
  return same && !waits && listed_at_ - folder_since_ > k_coarsest_clock &&
         now - listed_at_ < std::max<Clock::duration>(k_quiet, (next_at_ - listed_at_) * k_share_of_time /
                                                                   k_share_while_files_come);
}

void SettledFiles::list(Clock::time_point now) {
  const auto start = Clock::now();
  std::map<std::string, File> found;
  FolderContent content = content_of(folder_, wanted_, foreign_);
  for (std::string& name : content.names) {
    struct stat it {};
    if (::lstat(path(name).c_str(), &it) != 0) continue;  // it goes while it is looked at
    File file{it.st_size, ns_of(it.st_mtim), now, false};
    const auto before = files_.find(name);
    if (before != files_.end() && before->second.size == file.size &&
        before->second.changed_ns == file.changed_ns)
      file = before->second;
    found.emplace(std::move(name), file);
  }
  files_ = std::move(found);
  foreign_name_ = std::move(content.foreign), trouble_ = std::move(content.trouble);
  listed_at_ = now;
  next_at_ = now + k_share_while_files_come * (Clock::now() - start);
}

std::vector<std::string> SettledFiles::new_files(Clock::time_point now) {
  if (!may_skip(now)) list(now);
  std::vector<std::string> settled;
  for (const auto& [name, file] : files_)
    if (!file.done && std::chrono::duration<double>(now - file.since).count() >= settle_s_)
      settled.push_back(name);
  std::sort(settled.begin(), settled.end(), imaging::natural_less);
  return settled;
}

double SettledFiles::rest(const std::string& name, Clock::time_point now) const {
  return std::chrono::duration<double>(now - files_.at(name).since).count();
}

std::string SettledFiles::path(const std::string& name) const {
  return (std::filesystem::path(folder_) / name).string();
}

}  // namespace knothe::service
