#include "knothe/files/csv.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/numbers.hpp"

namespace knothe::files {

namespace {

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

std::string quoted_if_needed(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted.append(c == '"' ? 2 : 1, c);
  quoted += '"';
  return quoted;
}

/// What separates the most fields of a header, outside of quotes; a comma where nothing does.
char separator_of(const std::string& header) {
  std::size_t count[3] = {0, 0, 0};
  static constexpr char k_separators[] = {',', ';', '\t'};
  bool quoted = false;
  for (const char c : header) {
    quoted = quoted != (c == '"');
    for (std::size_t k = 0; k < 3; ++k) count[k] += !quoted && c == k_separators[k] ? 1 : 0;
  }
  return k_separators[std::max_element(count, count + 3) - count];
}

/// With a decimal comma, where nothing else is a comma.
std::string with_point(std::string text) {
  if (text.find('.') == std::string::npos && std::count(text.begin(), text.end(), ',') == 1)
    text[text.find(',')] = '.';
  return text;
}

}  // namespace

CsvTable CsvTable::read(const std::string& path) {
  std::string text;
  try {
    text = read_text(path);
  } catch (const IoError& error) {
    throw DataError(error.what());  // a data file that cannot be read is the data's fault, not the disk's
  }
  return parse(text, path);
}

CsvTable CsvTable::parse(const std::string& text, const std::string& path) {
  CsvTable table;
  table.path_ = path;
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF"))
    table.fail_at(1, 1, "the file is UTF-16: save as UTF-8");
  std::size_t number = 0;
  std::size_t start = text.starts_with("\xEF\xBB\xBF") ? 3 : 0;  // a byte-order mark is no part of the header
  while (start < text.size()) {
    const std::size_t end = std::min(text.find_first_of("\r\n", start), text.size());
    const std::string line = text.substr(start, end - start);
    start = end + (text.compare(end, 2, "\r\n") == 0 ? 2 : 1);
    ++number;
    if (const std::size_t at = line.find('\0'); at != std::string::npos)
      table.fail_at(number, at + 1,
                    "NUL bytes, as after a logger lost its power: the file is damaged; delete what is behind "
                    "the last whole line");
    if (trimmed(line).empty() || line.front() == '#') continue;
    if (table.header_.empty()) {
      if (line.size() == 5 && line.starts_with("sep=")) {
        table.separator_ = line[4];
        continue;
      }
      if (table.separator_ == ',') table.separator_ = separator_of(line);
      table.read_header(table.split(line, number));
    } else {
      table.add_row(table.split(line, number));
    }
  }
  if (table.header_.empty())
    table.fail_at(1, 1, "the file is empty: a header line with column names is needed");
  return table;
}

void CsvTable::read_header(std::vector<Field> fields) {
  while (fields.size() > 1 && fields.back().text.empty()) fields.pop_back();
  for (const Field& field : fields) {
    if (field.text.empty()) fail_at(field.line, field.column, "a column without a name");
    if (has(field.text))
      fail_at(field.line, field.column, fmt::format("column {} is there twice", field.text));
    header_.push_back(field.text);
  }
}

void CsvTable::add_row(std::vector<Field> fields) {
  if (std::all_of(fields.begin(), fields.end(), [](const Field& field) { return field.text.empty(); }))
    return;
  while (fields.size() > header_.size() && fields.back().text.empty()) fields.pop_back();
  if (fields.size() != header_.size())
    fail_at(fields.back().line, fields.back().column,
            fmt::format("{} fields, the header has {}", fields.size(), header_.size()));
  rows_.push_back(std::move(fields));
}

std::vector<CsvTable::Field> CsvTable::split(const std::string& line, std::size_t number) const {
  std::vector<Field> fields;
  std::size_t position = 0;
  while (true) {
    Field field{"", number, position + 1};
    const std::size_t quote = line.find_first_not_of(separator_ == '\t' ? " " : " \t", position);
    if (quote != std::string::npos && line[quote] == '"') {
      position = quote + 1;
      while (true) {
        const std::size_t next = line.find('"', position);
        if (next == std::string::npos) fail_at(number, quote + 1, "a quote that is not closed on this line");
        field.text += line.substr(position, next - position);
        position = next + 1;
        if (position >= line.size() || line[position] != '"') break;
        field.text += '"';
        ++position;
      }
      const std::size_t stop = std::min(line.find(separator_, position), line.size());
      if (!trimmed(line.substr(position, stop - position)).empty()) {
        fail_at(number, position + 1, "text after a closing quote");
      }
      position = stop;
    } else {
      const std::size_t stop = std::min(line.find(separator_, position), line.size());
      field.text = trimmed(line.substr(position, stop - position));
      position = stop;
    }
    fields.push_back(std::move(field));
    if (position >= line.size()) return fields;
    ++position;
  }
}

bool CsvTable::has(const std::string& column) const {
  return std::find(header_.begin(), header_.end(), column) != header_.end();
}

std::size_t CsvTable::index_of(const std::string& column) const {
  const auto found = std::find(header_.begin(), header_.end(), column);
  if (found == header_.end()) {
    fail_at(1, 1,
            fmt::format("column {} is missing{}; there are: {}", column, did_you_mean(column, header_),
                        fmt::join(header_, ", ")));
  }
  return found - header_.begin();
}

std::vector<std::string> CsvTable::texts(const std::string& column) const {
  const std::size_t index = index_of(column);
  std::vector<std::string> values;
  for (const auto& row : rows_) values.push_back(row[index].text);
  return values;
}

std::vector<double> CsvTable::numbers(const std::string& column, bool allow_nan) const {
  const std::size_t index = index_of(column);
  std::vector<double> values;
  for (const auto& row : rows_) {
    const Field& field = row[index];
    const auto number = field.text.empty() && allow_nan
                            ? std::numeric_limits<double>::quiet_NaN()
                            : parse_number(separator_ == ',' ? field.text : with_point(field.text));
    if (!number) {
      fail_at(field.line, field.column, fmt::format("column {}: \"{}\" is not a number", column, field.text));
    }
    if (std::isinf(*number) || (std::isnan(*number) && !allow_nan)) {
      fail_at(field.line, field.column, fmt::format("column {}: {} is not allowed here", column, field.text));
    }
    values.push_back(*number);
  }
  return values;
}

void CsvTable::fail(std::size_t row, const std::string& column, const std::string& message) const {
  const Field& field = rows_.at(row)[index_of(column)];
  fail_at(field.line, field.column, fmt::format("column {}: {}", column, message));
}

void CsvTable::fail_at(std::size_t line, std::size_t column, const std::string& message) const {
  throw DataError(fmt::format("{}:{}:{}: error: {}", path_, line, column, message));
}

CsvWriter::CsvWriter(std::span<const std::string> header) : columns_(header.size()) {
  add_texts(header);
}

void CsvWriter::add_row(std::span<const double> values) {
  assert(values.size() == columns_);
  for (const auto& value : values) {
    text_ += format_number(value);
    text_ += ',';
  }
  text_.back() = '\n';
}

void CsvWriter::add_texts(std::span<const std::string> values) {
  assert(values.size() == columns_);
  for (const auto& value : values) {
    text_ += quoted_if_needed(value);
    text_ += ',';
  }
  text_.back() = '\n';
}

void CsvWriter::write(const std::string& path) const {
  write_text_atomically(path, text_);
}

}  // namespace knothe::files
