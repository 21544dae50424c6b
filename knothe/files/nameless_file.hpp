#pragma once
/// @file What a process keeps on disk for itself alone.
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace knothe::files {

/// A file that nobody else finds, and that is gone when this is: old lines, old data. Made at the first
/// writing. Reading from several threads is safe, also while one writes.
class NamelessFile {
 public:
  /// `folder`: where it is.
  explicit NamelessFile(std::string folder) : folder_(std::move(folder)) {}
  ~NamelessFile();
  NamelessFile(const NamelessFile&) = delete;
  NamelessFile& operator=(const NamelessFile&) = delete;

  [[nodiscard]] const std::string& folder() const { return folder_; }
  /// False, and errno says why, where the file cannot be made or written: a full disk. Bytes beyond those
  /// written before may then be anything.
  [[nodiscard]] bool write(std::string_view bytes, std::int64_t offset);
  /// Nothing, and errno says why, where it cannot be read.
  [[nodiscard]] std::optional<std::string> read(std::int64_t offset, std::size_t size) const;

 private:
  std::string folder_;
  int file_ = -1;
};

}  // namespace knothe::files
