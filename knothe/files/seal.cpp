#include "knothe/files/seal.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <memory>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::files {
namespace {

constexpr std::size_t k_block = 512;
constexpr std::string_view k_mark = "knothe: sealed\n\x1a";  // no HDF5 file begins so, and `type` stops there
constexpr int k_patience_ms = 60'000;                        // for a child that does not end

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

/// mark | bytes that follow the block (8, little endian) | their SHA-256 (32) | SHA-256 of all that (32) |
/// zeros
std::string block_of(std::uint64_t size, const Digest& digest) {
  std::string block(k_mark);
  block.append(reinterpret_cast<const char*>(&size), sizeof size);
  block.append(digest.begin(), digest.end());
  const Digest own = sha256_of(block);
  block.append(own.begin(), own.end());
  block.resize(k_block, '\0');
  return block;
}

/// What became of `reading` in a child process: its complaint (empty: none), or that it did not survive.
struct ReadOutcome {
  bool survived = false;
  std::string complaint;
};

/// Never returns. Whatever the library does here, it does to this process alone.
[[noreturn]] void read_in_child(int out, rlim_t cpu_seconds, const std::function<void()>& reading) {
  const rlimit cpu{cpu_seconds, cpu_seconds};  // the library goes round for ever in some files
  (void)::setrlimit(RLIMIT_CPU, &cpu);
  const rlimit no_core{0, 0};
  (void)::setrlimit(RLIMIT_CORE, &no_core);
  const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  (void)::dup2(nowhere, STDOUT_FILENO);
  (void)::dup2(nowhere, STDERR_FILENO);
  std::string complaint = "\n";  // an end without it was not ours
  try {
    reading();
  } catch (const std::exception& error) {
    complaint += error.what();
  }
  (void)!::write(out, complaint.data(), std::min<std::size_t>(complaint.size(), 4096));
  ::_exit(0);
}

ReadOutcome try_in_child(const std::string& path, rlim_t cpu_seconds, const std::function<void()>& reading) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw system_error("could not make a pipe to read", path);
  const pid_t child = ::fork();
  if (child == 0) read_in_child(ends[1], cpu_seconds, reading);
  ::close(ends[1]);
  std::string said;
  pollfd waiting{ends[0], POLLIN, 0};
  while (child > 0) {
    const int ready = ::poll(&waiting, 1, k_patience_ms);
    if (ready < 0 && errno == EINTR) continue;
    std::array<char, 4096> buffer;
    const ssize_t n = ready > 0 ? ::read(ends[0], buffer.data(), buffer.size()) : 0;
    if (n <= 0) break;
    said.append(buffer.data(), n);
  }
  ::close(ends[0]);
  if (child < 0) throw system_error("could not start a process to read", path);
  ::kill(child, SIGKILL);  // it has ended, or does not
  while (::waitpid(child, nullptr, 0) < 0 && errno == EINTR) {
  }
  if (said.empty()) return {};
  return {true, said.substr(1)};
}

}  // namespace

void seal(const std::string& path) {
  const std::string content = read_text(path);
  const std::string block = block_of(content.size(), sha256_of(content));
  const File file(std::fopen(path.c_str(), "wb"), std::fclose);
  if (!file) throw system_error("could not write", path);
  for (const std::string* part : {&block, &content})
    if (std::fwrite(part->data(), 1, part->size(), file.get()) != part->size())
      throw system_error("could not write", path);
  if (std::fflush(file.get()) != 0) throw system_error("could not write", path);
}

SealState state_of_seal(const std::string& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) return SealState::none;
  const File file(std::fopen(path.c_str(), "rb"), std::fclose);
  if (!file) throw DataError(system_error("could not open the file", path).what());
  std::string block(k_block, '\0');
  block.resize(std::fread(block.data(), 1, k_block, file.get()));
  if (block.empty() || !block.starts_with(k_mark.substr(0, std::min(k_mark.size(), block.size())))) {
    // A damaged mark: the library's own beginning stands behind the block, not at 0.
    constexpr std::string_view k_signature = "\x89HDF\r\n\x1a\n";
    std::string behind(k_signature.size(), '\0');
    behind.resize(std::fread(behind.data(), 1, behind.size(), file.get()));
    return behind == k_signature && !block.starts_with(k_signature) ? SealState::broken : SealState::none;
  }
  const std::uint64_t size = status.st_size;
  std::uint64_t expected = 0;
  if (size >= k_block) std::memcpy(&expected, block.data() + k_mark.size(), sizeof expected);
  if (size < k_block || size - k_block < expected)
    throw DataError(fmt::format("{}: the file is truncated: copy or make it again ({} of {} bytes are there)",
                                path, size,
                                size < k_block ? "more than 512" : std::to_string(expected + k_block)));
  Sha256 sum;
  std::vector<std::uint8_t> buffer(1 << 16);
  while (const std::size_t n = std::fread(buffer.data(), 1, buffer.size(), file.get()))
    sum.add({buffer.data(), n});
  if (std::ferror(file.get()) != 0) throw DataError(path + ": cannot be read to its end");
  return block == block_of(size - k_block, sum.finish()) ? SealState::whole : SealState::broken;
}

void require_sound(const std::string& path, const std::function<void()>& reading) {
  const SealState state = state_of_seal(path);
  if (state == SealState::whole) return;
  // Where the seal is broken only the words are at stake; otherwise the file may be large and sound.
  const ReadOutcome outcome = try_in_child(path, state == SealState::broken ? 1 : 10, reading);
  if (outcome.survived && state == SealState::none) return;
  if (!outcome.complaint.empty()) throw DataError(outcome.complaint);
  throw DataError(fmt::format("{}: the file is damaged: {}; copy or make it again{}", path,
                              outcome.survived ? "its bytes are not those that were written (SHA-256)"
                                               : "the HDF5 library does not survive it",
                              state == SealState::broken && outcome.survived
                                  ? " (if it was changed on purpose: tail -c +513 gives it without its seal)"
                                  : ""));
}

}  // namespace knothe::files
