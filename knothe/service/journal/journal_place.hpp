#pragma once
/// @file Where a journal is on the disk, and what was acknowledged of it. Private to the room.
#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace knothe::service {

/// A file, whatever it is called.
struct FileIdentity {
  dev_t device = 0;
  ino_t number = 0;
  bool operator==(const FileIdentity&) const = default;
};
/// Of the file at `path`, symbolic links followed; nothing if there is none.
[[nodiscard]] std::optional<FileIdentity> file_identity(const std::string& path) noexcept;

/// What tells a journal's file from another that was written over it. Whoever moves SQLite's log into the
/// file leaves all of it as it is, or lets it grow.
struct FileHead {
  std::int64_t size = 0;
  std::uint32_t changes = 0;   ///< SQLite's own count
  std::size_t first_page = 0;  ///< hash of the first page, which has the tables' definitions, less its counts
  bool has_id = false;         ///< the journal's number is where it was written
  /// Whether `now` may have become of it without another file's having taken its place.
  [[nodiscard]] bool may_become(const FileHead& now) const {
    return now.size >= size && now.changes >= changes && now.first_page == first_page &&
           (now.has_id || !has_id);
  }
};

/// The lock that makes a writer the only one: on the journal itself, so neither another name for it nor a
/// deleted lock file lets a second one in. It goes with the process, however that ends.
class WriterLock {
 public:
  WriterLock() = default;  ///< none
  /// Makes the file if it is not there. DataError where another holds the lock; IoError.
  explicit WriterLock(const std::string& journal);
  ~WriterLock();
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

  [[nodiscard]] bool held() const { return descriptor_ >= 0; }
  [[nodiscard]] FileIdentity file() const { return file_; }
  /// `id`: the journal's number, which is in the page `id_page` (from 1). Nothing where it cannot be read.
  [[nodiscard]] std::optional<FileHead> head(std::int64_t id, std::int64_t id_page) const noexcept;

 private:
  int descriptor_ = -1;
  FileIdentity file_;
};

/// How much of a journal was acknowledged, kept beside it (NAME-mark): SQLite opens a journal whose log
/// (NAME-wal) was damaged or lost as it was before, without a word.
struct Acknowledged {
  std::string journal;  ///< its id
  std::int64_t records = 0, releases = 0, withdrawals = 0, alarms = 0, entries = 0;
  std::string seal;  ///< of the last record, in hex
};
/// Nothing where there is no mark, or none that can be read.
[[nodiscard]] std::optional<Acknowledged> read_mark(const std::string& journal);
[[nodiscard]] std::string mark_path_of(const std::string& journal);
/// With the raw bytes of the last seal in the place of `acknowledged.seal`. After a power failure it may be
/// older than the journal, by what was written since it was `synced` last; never newer. What cannot be
/// written is left; nothing is allocated.
void write_mark(const std::string& mark_path, const Acknowledged& acknowledged, std::string_view seal,
                bool synced) noexcept;
/// So that the names in the journal's folder are on disk.
void sync_folder_of(const std::string& path) noexcept;

}  // namespace knothe::service
