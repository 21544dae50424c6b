#pragma once
/// @file Text for people at a terminal: colours, and lines no longer than they read.
#include <cstddef>
#include <cstdio>
#include <string>

namespace knothe {

inline constexpr std::size_t k_line_width = 100;

enum class Colour { red, green, yellow, grey };

/// `text` in that colour, bold but for grey, where `stream` is a terminal; as it is where NO_COLOR is set
/// (no-color.org) or TERM is "dumb".
[[nodiscard]] std::string coloured(const std::string& text, Colour colour, std::FILE* stream);

/// `text` with its lines broken at blanks so that none has more than `width` characters, where that is
/// possible; what continues a line begins with `indent` blanks.
[[nodiscard]] std::string wrapped(const std::string& text, std::size_t width = k_line_width,
                                  std::size_t indent = 0);

/// Wrapped where `stream` is a terminal; as it is for what reads lines.
[[nodiscard]] std::string for_people(const std::string& text, std::FILE* stream, std::size_t indent = 0);

/// The first characters of `text`: as many as a terminal's line holds without breaking.
[[nodiscard]] std::string cut_to_terminal(const std::string& text, std::FILE* stream);

}  // namespace knothe
