#pragma once
/// @file JSON from other programs, read with bounds. The only place where JSON is parsed.
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace knothe::files {

/// How deep arrays and objects may be nested: what writes, copies and compares JSON calls itself once a
/// level.
inline constexpr int k_deepest_json = 64;

/// The value that `text` is. DataError where it is not JSON (RFC 8259), is nested deeper than
/// `k_deepest_json`, or has an object with a key that comes twice, which each reader would understand in its
/// own way; the message says where.
[[nodiscard]] nlohmann::json parse_json(std::string_view text);
/// The same of a file; DataError, which names it, also where it cannot be read.
[[nodiscard]] nlohmann::json read_json(const std::string& path);

}  // namespace knothe::files
