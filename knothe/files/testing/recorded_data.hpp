#pragma once
/// @file Where recorded data are that the repository does not hold.
#include <cstdlib>
#include <filesystem>
#include <string>

namespace knothe::files {

/// The folder `name` of recorded data, with a slash at its end: in $KNOTHE_DATA, else in ../shared/data
/// beside the source folder. It need not be there: a test without its data is skipped and says so.
inline std::string recorded_data(const std::string& name) {
  const char* data = std::getenv("KNOTHE_DATA");
  const auto folder = data != nullptr ? std::filesystem::path(data)
                                      : std::filesystem::path(KNOTHE_SOURCE_FOLDER) / "../shared/data";
  return (folder / name / "").lexically_normal().string();
}

}  // namespace knothe::files
