#include "knothe/service/site/regular_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"

namespace knothe::service {

// Without O_NONBLOCK a pipe would be waited for until somebody writes into it.
RegularFile::RegularFile(std::string path, std::uintmax_t max_bytes)
    : path_(std::move(path)),
      max_bytes_(max_bytes),
      descriptor_(::open(path_.c_str(), O_RDONLY | O_NONBLOCK | O_NOFOLLOW | O_NOCTTY | O_CLOEXEC)) {
  constexpr const char* k_kinds =
      "{}: is a symbolic link, a pipe, a device or a folder: only regular files are read";
  if (descriptor_ < 0) {
    if (errno == ELOOP || errno == ENXIO) throw DataError(fmt::format(k_kinds, path_));
    throw DataError(system_error("could not open the file", path_).what());
  }
  struct stat found {};
  std::string objection;
  if (::fstat(descriptor_, &found) != 0 || !S_ISREG(found.st_mode))
    objection = fmt::format(k_kinds, path_);
  else if (const std::uintmax_t size = found.st_size; size > max_bytes_)
    objection =
        fmt::format("{}: the file has {} MB; at most {} are read", path_, size >> 20, max_bytes_ >> 20);
  if (objection.empty()) return;
  ::close(descriptor_);
  throw DataError(objection);
}

RegularFile::~RegularFile() {
  ::close(descriptor_);
}

std::string RegularFile::content() const {
  std::string all;
  std::string piece(1 << 18, '\0');
  while (true) {
    const ssize_t n = ::pread(descriptor_, piece.data(), piece.size(), std::ssize(all));
    if (n < 0) throw DataError(system_error("could not read the file", path_).what());
    if (n == 0) return all;
    all.append(piece, 0, n);
    if (all.size() > max_bytes_)  // it grows
      throw DataError(fmt::format("{}: the file has more than {} MB", path_, max_bytes_ >> 20));
  }
}

std::string RegularFile::digest() const {
  Sha256 sum;
  std::string piece(1 << 18, '\0');
  for (std::uintmax_t at = 0; at <= max_bytes_;) {
    const ssize_t n = ::pread(descriptor_, piece.data(), piece.size(), at);
    if (n < 0) throw DataError(system_error("could not read the file", path_).what());
    if (n == 0) break;
    sum.add(std::string_view(piece).substr(0, n));
    at += n;
  }
  return to_hex(sum.finish());
}

std::string RegularFile::own_path() const {
  return fmt::format("/proc/self/fd/{}", descriptor_);
}

}  // namespace knothe::service
