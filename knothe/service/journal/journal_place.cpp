#include "knothe/service/journal/journal_place.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
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
  descriptor_ = ::open(journal.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
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

std::optional<FileHead> WriterLock::head(std::int64_t id, std::int64_t id_page) const noexcept {
  constexpr std::int64_t k_page = 4096;  // SQLite's own default
  std::array<char, k_page> page;
  struct stat found {};
  const ssize_t read = ::pread(descriptor_, page.data(), page.size(), 0);
  if (read < 0 || ::fstat(descriptor_, &found) != 0) return std::nullopt;
  FileHead head{found.st_size, 0, 0, false};
  // https://www.sqlite.org/fileformat.html, 1.3: the counts of changes and pages, the free pages, the
  // version.
  for (int k = 24; k < 28; ++k) head.changes = head.changes << 8 | static_cast<unsigned char>(page[k]);
  std::fill(page.begin() + 24, page.begin() + 40, '\0');
  std::fill(page.begin() + 92, page.begin() + 100, '\0');
  head.first_page = std::hash<std::string_view>()(std::string_view(page.data(), read));
  const ssize_t more = ::pread(descriptor_, page.data(), page.size(), (id_page - 1) * k_page);
  if (more <= 0) return head;
  // As SQLite has it: big endian, in six bytes where that is enough.
  std::array<char, 8> number;
  for (int k = 0; k < 8; ++k) number[k] = static_cast<char>(id >> (56 - 8 * k) & 0xff);
  const std::string_view wanted(number.data(), number.size());
  head.has_id = std::string_view(page.data(), more).find(wanted.substr(id >> 47 == 0 ? 2 : 0)) !=
                std::string_view::npos;
  return head;
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
  const bool is_empty = file && a.records == 0;    // there is no seal then
  if (!(file >> a.seal) && !is_empty) return std::nullopt;
  return head == "knothe-mark-1" || head == "knothe-mark-2" ? std::optional(a) : std::nullopt;
}

void write_mark(const std::string& mark_path, const Acknowledged& a, std::string_view seal,
                bool synced) noexcept {
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
      ::open(mark_path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW, 0600);
  if (descriptor < 0) return;
  [[maybe_unused]] const auto written = ::pwrite(descriptor, text.data(), end - text.data(), 0);
  if (synced) (void)::fdatasync(descriptor);
  ::close(descriptor);
}

void sync_folder_of(const std::string& path) noexcept {
  const auto slash = path.rfind('/');
  std::array<char, 4096> folder{'.'};
  if (slash != std::string::npos && slash < folder.size() - 1) path.copy(folder.data(), slash + 1);
  const int descriptor = ::open(folder.data(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  (void)::fsync(descriptor);
  ::close(descriptor);
}

}  // namespace knothe::service
