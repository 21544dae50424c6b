#include "knothe/service/journal/journal_place.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <functional>

#include "knothe/base/error.hpp"

namespace knothe::service {
std::optional<FileIdentity> file_identity(const std::string& path) noexcept {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) return std::nullopt;
  return FileIdentity{found.st_dev, found.st_ino};
}

// SQLite's own locks are of another kind (fcntl) and the process's: closing any descriptor of the file gives
// them up. So this one is opened before SQLite opens the journal, and closed after it has closed it.
WriterLock::WriterLock(const std::string& journal) {
  descriptor_ = ::open(journal.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (descriptor_ < 0) throw system_error("could not open the journal", journal);
  struct stat found {};
  const bool locked = ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0 && ::fstat(descriptor_, &found) == 0;
  if (!locked) {
    ::close(descriptor_);
    throw DataError(
        fmt::format("{}: another process writes this journal; a journal has one writer", journal));
  }
  file_ = {found.st_dev, found.st_ino};
}

std::optional<FileHead> WriterLock::head() const noexcept {
  std::array<char, 4096> page;
  struct stat found {};
  const ssize_t read = ::pread(descriptor_, page.data(), page.size(), 0);
  if (read < 0 || ::fstat(descriptor_, &found) != 0) return std::nullopt;
  return FileHead{found.st_size, std::hash<std::string_view>()(std::string_view(page.data(), read))};
}

WriterLock::~WriterLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::string mark_path_of(const std::string& journal) {
  return journal + "-mark";
}

std::optional<Acknowledged> read_mark(const std::string& journal) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(mark_path_of(journal), ignored)) return std::nullopt;
  std::ifstream file(mark_path_of(journal));
  std::string head;
  Acknowledged a;
  file >> head >> a.journal >> a.records >> a.releases >> a.withdrawals >> a.alarms;
  if (head == "knothe-mark-2") file >> a.entries;  // 1: of journals without a logbook
  if (!(file >> a.seal) || (head != "knothe-mark-1" && head != "knothe-mark-2")) return std::nullopt;
  return a;
}

void write_mark(const std::string& mark_path, const Acknowledged& a, std::string_view seal) noexcept {
  // Of one length, so that one write replaces it whole.
  std::array<char, 256> text;
  char* end = fmt::format_to_n(text.data(), text.size() - 2 * seal.size() - 1,
                               "knothe-mark-2 {:>16} {:>19} {:>19} {:>19} {:>19} {:>19} ", a.journal,
                               a.records, a.releases, a.withdrawals, a.alarms, a.entries)
                  .out;
  for (const char byte : seal) {
    *end++ = "0123456789abcdef"[static_cast<unsigned char>(byte) >> 4];
    *end++ = "0123456789abcdef"[static_cast<unsigned char>(byte) & 15];
  }
  *end++ = '\n';
  // What has taken the mark's place, a pipe or a link to another file, is neither waited for nor written.
  const int descriptor =
      ::open(mark_path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW, 0644);
  if (descriptor < 0) return;
  [[maybe_unused]] const auto written = ::pwrite(descriptor, text.data(), end - text.data(), 0);
  ::close(descriptor);
}

}  // namespace knothe::service
