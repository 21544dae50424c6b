#include "knothe/files/atomic_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <filesystem>

#include "knothe/base/error.hpp"

namespace knothe::files {

namespace {

namespace fs = std::filesystem;

/// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int get() const { return number_; }
  /// Closes now, because on network file systems that is where a full disk may show.
  bool close() {
    const int number = number_;
    number_ = -1;
    return ::close(number) == 0;
  }

 private:
  int number_;
};

void sync_to_disk(const std::string& path, int flags) {
  Descriptor file(::open(path.c_str(), flags | O_CLOEXEC));
  if (file.get() < 0) throw system_error("could not reopen the file just written", path);
  // A folder or special file that cannot be synced says EINVAL: nothing more can be done for it.
  if (::fsync(file.get()) != 0 && errno != EINVAL) throw system_error("could not write to disk", path);
  if (!file.close()) throw system_error("could not write to disk", path);
}

/// A name in the folder of `path` that no other writer of this machine uses at the same time.
std::string temporary_name(const fs::path& path) {
  static std::atomic<unsigned> counter{0};
  const fs::path name = fmt::format(".{}.{}-{}.part", path.filename().string(), ::getpid(), counter++);
  return (path.parent_path() / name).string();
}

void write_all(int descriptor, const std::string& text, const std::string& path) {
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t written = ::write(descriptor, text.data() + done, text.size() - done);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw system_error("could not write", path);
    done += written;
  }
}

}  // namespace

void write_atomically(const std::string& path,
                      const std::function<void(const std::string& temporary)>& write) {
  const fs::path target(path);
  const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
  std::error_code failure;
  fs::create_directories(folder, failure);
  if (failure) {
    errno = failure.value();
    throw system_error("could not make the folder", folder.string());
  }
  const std::string temporary = temporary_name(target);
  try {
    write(temporary);
    sync_to_disk(temporary, O_RDONLY);
    if (std::rename(temporary.c_str(), path.c_str()) != 0) throw system_error("could not write", path);
    sync_to_disk(folder.string(), O_RDONLY | O_DIRECTORY);
  } catch (...) {
    std::remove(temporary.c_str());
    throw;
  }
}

void write_text_atomically(const std::string& path, const std::string& text) {
  write_atomically(path, [&](const std::string& temporary) {
    Descriptor file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666));
    if (file.get() < 0) throw system_error("could not write", path);
    write_all(file.get(), text, path);
    if (!file.close()) throw system_error("could not write", path);
  });
}

void refuse_overwriting(const std::string& output, std::initializer_list<std::string> inputs) {
  std::error_code none;
  for (const std::string& input : inputs)
    if (!input.empty() && fs::equivalent(output, input, none))
      throw UsageError(fmt::format("-o {}: is what the command reads; give another name", output));
}

void require_writable_folder(const std::string& folder) {
  std::error_code failure;
  std::filesystem::create_directories(folder, failure);
  if (failure) {
    errno = failure.value();
    throw system_error("could not make the folder for results", folder);
  }
  if (access(folder.c_str(), W_OK | X_OK) != 0)
    throw system_error("may not write to the folder for results", folder);
}

std::string read_text(const std::string& path) {
  Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0) throw system_error("could not read", path);
  std::string text;
  char buffer[1 << 16];
  while (true) {
    const ssize_t n = ::read(file.get(), buffer, sizeof buffer);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw system_error("could not read", path);
    if (n == 0) return text;
    text.append(buffer, n);
  }
}

}  // namespace knothe::files
