#pragma once
/// @file Small services on text.
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace knothe {

/// Number of insertions, deletions, substitutions and swaps of neighbours that turn `a` into `b`.
[[nodiscard]] std::size_t edit_distance(std::string_view a, std::string_view b);

/// The candidate nearest to `word`, if it is near enough to be a likely slip of the fingers; otherwise empty.
[[nodiscard]] std::string near_miss(std::string_view word, std::span<const std::string> candidates);

/// ` (did you mean "…"?)`, or nothing.
[[nodiscard]] std::string did_you_mean(std::string_view word, std::span<const std::string> candidates);

/// "1 value", "2 values": of a noun with a regular plural.
[[nodiscard]] std::string counted(std::size_t count, std::string_view noun);

/// `text` with the five characters that mean something in XML replaced, and control characters that XML
/// forbids left out. Fit for element content and for attribute values in double quotes.
[[nodiscard]] std::string escape_xml(std::string_view text);

/// The 64-bit hash of Fowler, Noll and Vo (FNV-1a), for names of files.
[[nodiscard]] std::uint64_t fnv1a(std::string_view text);

}  // namespace knothe
