#pragma once
/// @file The format that a file's name tells.
#include <algorithm>
#include <cctype>
#include <filesystem>
#include <string>

namespace knothe::files {

/// ".csv" of "D1.CSV": in lower case, with the dot; empty without one.
[[nodiscard]] inline std::string extension_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

}  // namespace knothe::files
