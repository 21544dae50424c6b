#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/files/fields/field_formats.hpp"

namespace knothe::files {
namespace {

/// The words of a comment; what is in quotes is one, perhaps empty.
std::vector<std::string> words_of(std::string_view text) {
  std::vector<std::string> words;
  while (!text.empty()) {
    const bool quoted = text.front() == '"';
    const std::size_t end = std::min(text.find_first_of(quoted ? "\"" : " \t", 1), text.size());
    const std::string_view word = quoted ? text.substr(1, end - 1) : text.substr(0, end);
    if (quoted || !(word.empty() || word == " ")) words.emplace_back(word);
    text.remove_prefix(std::min(end + 1, text.size()));
    while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  }
  return words;
}

/// The only table of a file without a head, each of whose rows has `count` cells.
FieldBlock& table_of(FieldText& file, std::size_t count) {
  if (file.blocks.size() != 1 || file.blocks[0].rows.empty())
    throw DataError(file.path + ": a comment and rows of numbers are expected");
  for (const FieldBlock::Row& row : file.blocks[0].rows)
    if (row.cells.size() < count)
      file.fail(row.line, fmt::format("{} numbers, at least {} are expected", row.cells.size(), count));
  return file.blocks[0];
}

double number_at(const FieldText& file, const FieldBlock::Row& row, std::size_t column) {
  const auto number = file.number(row.cells[column]);
  if (!number) file.fail(row.line, fmt::format("\"{}\" is not a number", row.cells[column]));
  return *number;
}

}  // namespace

ExportedField read_davis_text(FieldText file, const FieldMapping& mapping) {
  FieldBlock& block = table_of(file, 4);
  const std::vector<std::string> head = words_of(file.comments.at(0));
  block.names = {"x", "y", "u", "v"};
  block.units = {"", "", "", ""};
  // Version, kind, spacing, rows, columns, then a name and a unit of x, of y and of the displacement.
  if (head.size() >= 12) block.units = {head[7], head[9], head[11], head[11]};
  std::size_t at_rest = 0;
  for (FieldBlock::Row& row : block.rows) {
    row.cells.resize(4);
    at_rest += number_at(file, row, 2) == 0 && number_at(file, row, 3) == 0 ? 1 : 0;
  }
  if (const auto rows = file.number(head.size() > 5 ? head[4] : ""),
      columns = file.number(head.size() > 5 ? head[5] : "");
      rows && columns && *rows * *columns != double(block.rows.size()))
    throw DataError(
        fmt::format("{}: the head says {} rows of {} points, there are {} points: the file is cut off",
                    file.path, *rows, *columns, block.rows.size()));
  FieldMapping declared = mapping;
  declared.format = "table";
  if (!declared.lost) {
    if (at_rest > 1 && at_rest < block.rows.size())
      throw DataError(
          fmt::format("{}: {} points have a displacement of exactly 0, and the format does not say "
                      "which points are lost: give data.fields.lost, [\"u = 0\"] if these are, else []",
                      file.path, at_rest));
    declared.lost.emplace();
  }
  ExportedField field = read_columns(file, declared);
  field.format = "davis-text", field.is_current = false;
  return field;
}

ExportedField read_aramis_text(FieldText file) {
  const FieldBlock& block = table_of(file, 4);
  ExportedField field;
  field.path = file.path, field.format = "aramis-text";
  bool is_known = false, displacements = false;
  double before = std::numeric_limits<double>::quiet_NaN();
  for (std::string_view comment : file.comments) {
    if (comment.starts_with("Index_x")) {
      displacements = comment.find("Displ(x,y") != std::string_view::npos;
      is_known = displacements || comment.find("Coordinate-undef") != std::string_view::npos;
      continue;
    }
    if (comment.starts_with("Time")) comment.remove_prefix(std::min(comment.find(':') + 1, comment.size()));
    const std::vector<std::string> words =
        words_of(comment.substr(std::min(comment.find_first_not_of(" \t"), comment.size())));
    if (words.size() < 2) continue;
    if (words[0] == "undeformt:") before = file.number(words[1]).value_or(before);
    if (words[0] == "deformt:" && !std::isnan(before))
      field.time = file.number(words[1]).value_or(before) - before;
    if (words[0].starts_with("AD-") && words[0].ends_with(":") && words.size() > 2)
      if (const auto value = file.number(words[2]); value && !std::isnan(*value))
        field.scalars[words[0].substr(0, words[0].size() - 1)] = *value;
  }
  if (!is_known)
    throw DataError(file.path +
                    ": behind Index_x, Index_y neither Displ(x,y,z) nor Coordinate-undef (x,y,z): "
                    "export displacements and undeformed coordinates");
  for (const FieldBlock::Row& row : block.rows) {
    field.id.push_back({number_at(file, row, 0), number_at(file, row, 1)});
    (displacements ? field.u : field.x).push_back(number_at(file, row, 2));
    (displacements ? field.v : field.y).push_back(number_at(file, row, 3));
  }
  if (!displacements) field.time.reset(), field.scalars.clear();
  return field;
}

ExportedField read_matchid_matrix(const std::string& path, const std::vector<double>& grid) {
  if (grid.size() != 4)
    throw DataError(
        path +
        ": a matrix has no positions: give data.fields.grid = [x, y, step along x, step along y], "
        "of the first value, in its unit");
  std::filesystem::path other(path);
  std::string name = other.filename().string();
  const std::size_t at = name.find("_U[");
  const std::string unit = name.substr(at + 3, name.find(']', at) - at - 3);
  other.replace_filename(name.replace(at + 1, 1, "V"));
  const FieldText files[] = {read_field_text(path), read_field_text(other.string())};
  ExportedField field;
  field.path = path, field.format = "matchid-matrix", field.is_current = false;
  field.position_unit = field.displacement_unit = unit;
  for (const FieldText& file : files) {
    std::vector<double>& values = &file == files ? field.u : field.v;
    double y = grid[1];
    // A row without any number looks like a head.
    for (const FieldBlock& block : file.blocks) {
      std::vector<std::vector<std::string_view>> rows;
      if (!block.names.empty()) rows.emplace_back(block.names.begin(), block.names.end());
      for (const FieldBlock::Row& row : block.rows) rows.push_back(row.cells);
      for (auto& cells : rows) {
        while (!cells.empty() && cells.back().empty()) cells.pop_back();
        double x = grid[0];
        for (const std::string_view cell : cells) {
          const auto number = file.number(cell);
          if (!number) throw DataError(fmt::format("{}: \"{}\" is not a number", file.path, cell));
          values.push_back(*number);
          if (&file == files) field.x.push_back(x), field.y.push_back(y);
          x += grid[2];
        }
        y += grid[3];
      }
    }
  }
  if (field.u.size() != field.v.size())
    throw DataError(
        fmt::format("{}: {} values, {} in {}", path, field.u.size(), field.v.size(), files[1].path));
  field.lost_by = "words instead of numbers";
  return field;
}

}  // namespace knothe::files
