#pragma once
/// @file Pictures in memory, for who sends them on.
#include <string>

#include "knothe/files/picture.hpp"

namespace knothe::files {

/// What `write_png` writes. Errors: UsageError for a value that is not finite.
[[nodiscard]] std::string png_bytes(const Picture& picture);

}  // namespace knothe::files
