#include "knothe/files/fields/field_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/numbers.hpp"

namespace knothe::files {
namespace {

using Cells = std::vector<std::string_view>;

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

std::string_view unquoted(std::string_view cell) {
  cell = trimmed(cell);
  if (cell.size() >= 2 && cell.front() == '"' && cell.back() == '"') cell = cell.substr(1, cell.size() - 2);
  return trimmed(cell);
}

/// Whether every word of a line is a number with a decimal comma or none: "1,5 2 3,5".
bool blanks_separate(std::string_view line);

/// Outside of quotes: a semicolon where there is one, since numbers beside it may have a decimal comma.
char separator_of(std::string_view line) {
  std::size_t semicolons = 0, tabs = 0, commas = 0;
  bool quoted = false;
  for (const char c : line) {
    quoted = quoted != (c == '"');
    if (quoted) continue;
    semicolons += c == ';' ? 1 : 0, tabs += c == '\t' ? 1 : 0, commas += c == ',' ? 1 : 0;
  }
  return semicolons > 0 ? ';' : tabs > 0 ? '\t' : commas > 0 && !blanks_separate(line) ? ',' : ' ';
}

Cells split(std::string_view line, char separator) {
  Cells cells;
  if (separator == ' ') {
    for (std::size_t at = line.find_first_not_of(" \t"); at != std::string_view::npos;) {
      const std::size_t end = std::min(line.find_first_of(" \t", at), line.size());
      cells.push_back(unquoted(line.substr(at, end - at)));
      at = line.find_first_not_of(" \t", end);
    }
    return cells;
  }
  bool quoted = false;
  std::size_t start = 0;
  for (std::size_t at = 0; at <= line.size(); ++at) {
    if (at < line.size() && line[at] == '"') quoted = !quoted;
    if (at < line.size() && (quoted || line[at] != separator)) continue;
    cells.push_back(unquoted(line.substr(start, at - start)));
    start = at + 1;
  }
  return cells;
}

std::optional<double> with_decimal_comma(std::string_view cell) {
  if (cell.find('.') != std::string_view::npos || std::count(cell.begin(), cell.end(), ',') != 1)
    return parse_number(cell);
  std::string with_point(cell);
  with_point[with_point.find(',')] = '.';
  return parse_number(with_point);
}

bool blanks_separate(std::string_view line) {
  const Cells words = split(line, ' ');
  return words.size() > 1 && std::all_of(words.begin(), words.end(), with_decimal_comma);
}

bool has_digit(std::string_view cell) {
  return std::any_of(cell.begin(), cell.end(), [](char c) { return c >= '0' && c <= '9'; });
}

/// The names of a head with their units.
FieldBlock block_of(Cells cells) {
  while (!cells.empty() && cells.back().empty()) cells.pop_back();
  FieldBlock block;
  for (const std::string_view cell : cells) {
    const std::size_t open = cell.rfind('[');
    const bool has_unit = open != std::string_view::npos && open > 0 && cell.back() == ']';
    block.names.emplace_back(has_unit ? trimmed(cell.substr(0, open)) : cell);
    block.units.emplace_back(has_unit ? trimmed(cell.substr(open + 1, cell.size() - open - 2))
                                      : std::string_view());
  }
  return block;
}

/// Whether no cell is a number: neither 1.5 nor nan.
bool names_columns(const FieldText& file, const Cells& cells) {
  return cells.size() > 1 && std::none_of(cells.begin(), cells.end(), [&](std::string_view cell) {
           return has_digit(cell) ? file.number(cell).has_value() : parse_number(cell).has_value();
         });
}

/// A second line of names is the units of the first, unless it is the same again: a table without rows.
bool take_units(const Cells& cells, FieldBlock& block) {
  if (cells.size() > block.names.size() + 1 || cells.front() == block.names.front()) return false;
  for (std::size_t k = 0; k < std::min(cells.size(), block.names.size()); ++k)
    if (!cells[k].empty()) block.units[k] = cells[k];
  return true;
}

void add_row(FieldText& file, std::size_t line, Cells cells) {
  if (file.blocks.empty()) {
    file.blocks.emplace_back();
    if (!file.comments.empty())
      if (FieldBlock head = block_of(split(file.comments.back(), file.separator));
          head.names.size() == cells.size())
        file.blocks.back() = std::move(head);
  }
  FieldBlock& block = file.blocks.back();
  const std::size_t count = block.names.size();
  while (count > 0 && cells.size() > count && cells.back().empty()) cells.pop_back();
  if (count > 0 && cells.size() != count)
    file.fail(line, fmt::format("{} fields, the head of the table has {}", cells.size(), count));
  block.rows.push_back({line, std::move(cells)});
}

/// Of windows-1252: what 0x80 to 0x9F stand for; the other characters are those of Unicode.
constexpr std::array<char32_t, 32> k_windows_1252{
    0x20AC, 0x81,   0x201A, 0x0192, 0x201E, 0x2026, 0x2020, 0x2021, 0x02C6, 0x2030, 0x0160,
    0x2039, 0x0152, 0x8D,   0x017D, 0x8F,   0x90,   0x2018, 0x2019, 0x201C, 0x201D, 0x2022,
    0x2013, 0x2014, 0x02DC, 0x2122, 0x0161, 0x203A, 0x0153, 0x9D,   0x017E, 0x0178};

void append(std::string& text, char32_t c) {
  const auto byte = [&](char32_t value) { text += char(value); };
  if (c < 0x80) return byte(c);
  if (c < 0x800) {
    byte(0xC0 | c >> 6);
  } else {
    byte(0xE0 | c >> 12), byte(0x80 | (c >> 6 & 0x3F));
  }
  byte(0x80 | (c & 0x3F));
}

bool is_utf8(std::string_view text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    const unsigned char c = text[i];
    const int more = c < 0x80                ? 0
                     : c >= 0xC2 && c < 0xE0 ? 1
                     : c >= 0xE0 && c < 0xF0 ? 2
                     : c >= 0xF0 && c < 0xF5 ? 3
                                             : -1;
    if (more < 0 || i + more >= text.size() + (more == 0 ? 1 : 0)) return false;
    for (int k = 0; k < more; ++k)
      if ((text[++i] & 0xC0) != 0x80) return false;
  }
  return true;
}

/// Surrogates, which no program writes for numbers, become question marks.
std::string of_utf16(std::string_view bytes, bool big_endian) {
  std::string text;
  for (std::size_t i = 0; i + 1 < bytes.size(); i += 2) {
    const unsigned char low = bytes[i + (big_endian ? 1 : 0)], high = bytes[i + (big_endian ? 0 : 1)];
    const char32_t c = char32_t(high) << 8 | low;
    append(text, c >= 0xD800 && c < 0xE000 ? U'?' : c);
  }
  return text;
}

}  // namespace

std::string utf8_of(std::string bytes, const std::string& path) {
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.erase(0, 3);
  if (bytes.starts_with("\xFF\xFE") || bytes.starts_with("\xFE\xFF"))
    return of_utf16(std::string_view(bytes).substr(2), bytes[0] == '\xFE');
  // Without a mark: the first character of a head is Latin, so that one of its two bytes is 0.
  if (bytes.size() > 3 && (bytes[0] == 0) != (bytes[1] == 0) && (bytes[0] == 0) == (bytes[2] == 0))
    return of_utf16(bytes, bytes[0] == 0);
  if (const std::size_t at = bytes.find('\0'); at != std::string::npos)
    throw DataError(
        fmt::format("{}: NUL bytes (the first is byte {}): the file is damaged, or not a text", path, at));
  if (is_utf8(bytes)) return bytes;
  std::string text;
  for (const unsigned char c : bytes) append(text, c >= 0x80 && c < 0xA0 ? k_windows_1252[c - 0x80] : c);
  return text;
}

std::optional<double> FieldText::number(std::string_view cell) const {
  if (!has_digit(cell)) return std::numeric_limits<double>::quiet_NaN();
  return separator == ',' ? parse_number(cell) : with_decimal_comma(cell);
}

void FieldText::fail(std::size_t line, const std::string& message) const {
  throw DataError(fmt::format("{}:{}: error: {}", path, line, message));
}

FieldText read_field_text(const std::string& path) {
  FieldText file;
  file.path = path;
  try {
    file.text = std::make_shared<const std::string>(utf8_of(read_text(path), path));
  } catch (const IoError& error) {
    throw DataError(error.what());
  }
  const std::string_view text = *file.text;
  bool has_separator = false, after_head = false;
  std::size_t number = 0;
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find_first_of("\r\n", start), text.size());
    const std::string_view raw = text.substr(start, end - start), line = trimmed(raw);
    start = end + (text.substr(end, 2) == "\r\n" ? 2 : 1);
    ++number;
    if (line.find_first_not_of(";,") == std::string_view::npos) continue;
    if (line.starts_with('#') || line.starts_with("***")) {
      const std::size_t first = std::min(line.find_first_not_of("#*"), line.size());
      file.comments.push_back(trimmed(line.substr(first)));
      continue;
    }
    if (!has_separator) file.separator = separator_of(line), has_separator = true;
    Cells cells = split(file.separator == '\t' ? raw : line, file.separator);
    const bool is_head = names_columns(file, cells);
    if (!is_head || !after_head || !take_units(cells, file.blocks.back())) {
      if (is_head)
        file.blocks.push_back(block_of(std::move(cells))), file.blocks.back().line = number;
      else
        add_row(file, number, std::move(cells));
    }
    after_head = is_head && !after_head;
  }
  return file;
}

}  // namespace knothe::files
