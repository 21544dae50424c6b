#pragma once
/// @file Tables of text: a header line with the columns' names, then one line per row.
#include <span>
#include <string>
#include <vector>

namespace knothe::files {

/// A table read from a file, as programs for laboratories and offices write it: fields separated by commas,
/// semicolons or tabs (what the header has; or as a first line "sep=;" says), perhaps in double quotes. With
/// semicolons or tabs numbers may have a decimal comma. Lines end in LF, CR LF or CR. Empty lines, rows and
/// unnamed columns without content, and lines that start with '#' are skipped. All errors are DataError,
/// "file:line:column: error: …" (line and column from 1).
class CsvTable {
 public:
  [[nodiscard]] static CsvTable read(const std::string& path);
  /// `path` is only what messages call it.
  [[nodiscard]] static CsvTable parse(const std::string& text, const std::string& path);

  [[nodiscard]] const std::vector<std::string>& header() const { return header_; }
  [[nodiscard]] std::size_t row_count() const { return rows_.size(); }
  [[nodiscard]] bool has(const std::string& column) const;
  /// A column as text. A column that is missing: DataError with the nearest name.
  [[nodiscard]] std::vector<std::string> texts(const std::string& column) const;
  /// A column as numbers; NaN (also an empty field) only where `allow_nan`, infinity never.
  [[nodiscard]] std::vector<double> numbers(const std::string& column, bool allow_nan = false) const;
  /// Throws the DataError `message` at the place of row `row` of `column`, for checks by the caller.
  [[noreturn]] void fail(std::size_t row, const std::string& column, const std::string& message) const;

 private:
  struct Field {
    std::string text;
    std::size_t line = 0;
    std::size_t column = 0;
  };
  [[nodiscard]] std::size_t index_of(const std::string& column) const;
  [[noreturn]] void fail_at(std::size_t line, std::size_t column, const std::string& message) const;
  [[nodiscard]] std::vector<Field> split(const std::string& line, std::size_t number) const;
  void read_header(std::vector<Field> fields);
  void add_row(std::vector<Field> fields);

  std::string path_;
  char separator_ = ',';
  std::vector<std::string> header_;
  std::vector<std::vector<Field>> rows_;
};

/// Builds a table row by row; numbers are written so that they read back to the same double.
class CsvWriter {
 public:
  explicit CsvWriter(std::span<const std::string> header);
  void add_row(std::span<const double> values);
  /// Fields that are already text are quoted where they need it.
  void add_texts(std::span<const std::string> values);
  [[nodiscard]] const std::string& text() const { return text_; }
  /// Atomically; IoError.
  void write(const std::string& path) const;

 private:
  std::size_t columns_;
  std::string text_;
};

}  // namespace knothe::files
