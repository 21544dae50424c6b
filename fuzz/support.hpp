#pragma once
/// @file For fuzz targets: bytes as a file, and what a parser may throw.
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "knothe/base/error.hpp"

namespace knothe::fuzz {

/// A name in memory that is this process's own, for parsers that want a file.
inline const std::string& scratch_file() {
  static const std::string k_name = [] {
    std::error_code none;
    const bool shared = std::filesystem::is_directory("/dev/shm", none);
    return std::string(shared ? "/dev/shm" : "/tmp") + "/knothe-fuzz-" + std::to_string(::getpid());
  }();
  static const struct Remover {
    ~Remover() { std::remove(k_name.c_str()); }
  } k_remover;
  return k_name;
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
