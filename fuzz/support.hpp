#pragma once
/// @file For fuzz targets: bytes as a file, and what a parser may throw.
#include <fcntl.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "knothe/base/error.hpp"

namespace knothe::fuzz {

/// A name in memory that is this process's own, for parsers that want a file. It stands in messages, of which
/// libFuzzer learns, so it is spelt alike in every process: by the number of an open folder.
inline const std::string& scratch_file() {
  static const struct Folder {
    std::string path, file;
    Folder() {
      constexpr int k_number = 100;
      path = "/dev/shm/knothe-fuzz-XXXXXX";
      if (::mkdtemp(path.data()) == nullptr) {
        path = "/tmp/knothe-fuzz-XXXXXX";
        if (::mkdtemp(path.data()) == nullptr) std::abort();
      }
      const int folder = ::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
      if (folder < 0 || ::dup2(folder, k_number) < 0) std::abort();
      ::close(folder);
      file = "/proc/self/fd/" + std::to_string(k_number) + "/input";
    }
    ~Folder() {
      std::error_code none;
      std::filesystem::remove_all(path, none);
    }
  } k_folder;
  return k_folder.file;
}

inline const std::string& write_scratch(const std::uint8_t* data, std::size_t size) {
  std::ofstream file(scratch_file(), std::ios::binary | std::ios::trunc);
  file.write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  if (!file.flush()) std::abort();  // the machine's fault, not the parser's: better loud
  return scratch_file();
}

inline std::string text_of(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

/// Runs a parser: it may refuse (an error of ours, with words), and nothing else.
template <class Parse>
void refuse_or_accept(Parse parse) {
  try {
    parse();
  } catch (const Error& error) {
    if (error.what()[0] == '\0') std::abort();
  }
}

}  // namespace knothe::fuzz
