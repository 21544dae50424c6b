#pragma once
/// @file VTK's XML files read: unstructured grids (.vtu) with the fields on their points, and series (.pvd).
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "knothe/files/vtu.hpp"

namespace knothe::files {

/// What a .vtu file holds, cells of any type.
struct VtuContents {
  std::vector<double> points;              ///< [n, 3]
  std::vector<std::int64_t> connectivity;  ///< points of one cell after the other
  std::vector<std::int64_t> offsets;       ///< [c], where each cell ends in it
  std::vector<std::int64_t> types;         ///< [c], VTK's numbers
  std::vector<VtuField> point_fields;      ///< of numbers
  std::optional<double> time;              ///< TimeValue, where the file has it
};

/// Reads ASCII, base64 and raw data, also compressed by zlib; one piece; little-endian. Errors: DataError
/// "file:line:column: error: …" that says what to save differently.
[[nodiscard]] VtuContents read_vtu(const std::string& path);
/// The same of a file's content; `path` is for messages.
[[nodiscard]] VtuContents parse_vtu_contents(const std::string& text, const std::string& path);

/// The files of a series in the order of their times; several parts of one time are refused. DataError.
[[nodiscard]] std::vector<PvdEntry> read_pvd(const std::string& path);

}  // namespace knothe::files
