#pragma once
/// @file Text tables as programs for image correlation write them: comments, then one or more blocks, each a
/// line of names and its rows.
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace knothe::files {

/// Names and the rows below them. Lines count from 1.
struct FieldBlock {
  std::vector<std::string> names, units;  ///< of the columns: "x [mm]" is "x" and "mm"
  std::size_t line = 0;                   ///< of the names
  struct Row {
    std::size_t line = 0;
    std::vector<std::string_view> cells;  ///< as many as there are names, if there are names
  };
  std::vector<Row> rows;
};

/// A text file by lines. Lines of comment begin with '#' or "***". A line without any number is the head of
/// a new block; where no line is, the last comment of as many fields is.
struct FieldText {
  std::string path;
  std::shared_ptr<const std::string> text;  ///< UTF-8; what `comments` and cells look at
  char separator = ',';                     ///< ' ' for any blanks
  std::vector<std::string_view> comments;   ///< without '#', trimmed
  std::vector<FieldBlock> blocks;

  /// A cell as number, with a decimal comma where that separates nothing. NaN for a cell without a digit: a
  /// lost point, in whatever language. Nothing for anything else.
  [[nodiscard]] std::optional<double> number(std::string_view cell) const;
  /// Throws DataError, "file:line: error: …".
  [[noreturn]] void fail(std::size_t line, const std::string& message) const;
};

/// `bytes` as UTF-8: what is not that already is UTF-16 (with a mark or without) or windows-1252. Line ends
/// stay. DataError where there are NUL bytes.
[[nodiscard]] std::string utf8_of(std::string bytes, const std::string& path);

/// Reads a file. DataError where a row has more or fewer fields than its head.
[[nodiscard]] FieldText read_field_text(const std::string& path);

}  // namespace knothe::files
