#include "knothe/files/nameless_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>

namespace knothe::files {
namespace {

/// Negative: it cannot be made.
int open_nameless(const std::string& folder) {
  const int file = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (file >= 0) return file;
  std::string name = folder + "/.knothe-old-XXXXXX";  // of a file system that knows of no such files
  const int named = ::mkostemp(name.data(), O_CLOEXEC);
  if (named >= 0) (void)::unlink(name.c_str());
  return named;
}

}  // namespace

NamelessFile::~NamelessFile() {
  if (file_ >= 0) ::close(file_);
}

bool NamelessFile::write(std::string_view bytes, std::int64_t offset) {
  if (file_ < 0) file_ = open_nameless(folder_);
  if (file_ < 0) return false;
  while (!bytes.empty()) {
    const auto written = ::pwrite(file_, bytes.data(), bytes.size(), offset);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    bytes.remove_prefix(written);
    offset += written;
  }
  return true;
}

std::optional<std::string> NamelessFile::read(std::int64_t offset, std::size_t size) const {
  std::string bytes(size, '\0');
  std::size_t done = 0;
  while (done < size) {
    const auto read = ::pread(file_, bytes.data() + done, size - done, offset + done);
    if (read < 0 && errno == EINTR) continue;
    if (read <= 0) return std::nullopt;
    done += read;
  }
  return bytes;
}

}  // namespace knothe::files
