#pragma once
/// @file A file that others have put into a folder, opened so that it can neither keep us waiting nor lead
/// elsewhere.
#include <cstdint>
#include <string>

namespace knothe::service {

class RegularFile {
 public:
  /// DataError where it is a symbolic link, a pipe, a device or a folder, has more than `max_bytes`, or
  /// cannot be opened.
  RegularFile(std::string path, std::uintmax_t max_bytes);
  ~RegularFile();
  RegularFile(const RegularFile&) = delete;
  RegularFile& operator=(const RegularFile&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  /// DataError where it cannot be read to its end.
  [[nodiscard]] std::string content() const;
  /// SHA-256 of the content, in hex. The same.
  [[nodiscard]] std::string digest() const;
  /// Another name for this very file, whatever has taken its place in the folder meanwhile.
  [[nodiscard]] std::string own_path() const;

 private:
  std::string path_;
  std::uintmax_t max_bytes_;
  int descriptor_ = -1;
};

}  // namespace knothe::service
