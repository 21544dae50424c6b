#pragma once
/// @file Where in a text file a mistake is. Private to the room.
#include <cstddef>
#include <string>

namespace knothe::files {

/// Throws DataError "path:line:column: error: message" for byte `offset` of `text`.
[[noreturn]] void fail_at_offset(const std::string& path, const std::string& text, std::size_t offset,
                                 const std::string& message);

}  // namespace knothe::files
