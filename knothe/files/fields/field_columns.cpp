#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/files/fields/field_formats.hpp"
#include "knothe/files/units.hpp"

namespace knothe::files {
namespace {

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

/// What is known of a program's table: its columns by what they are, and what it does not say of them.
struct ColumnFormat {
  const char* name;
  std::vector<std::string> x_y_u_v;  ///< two for a table of positions alone
  std::vector<std::string> id;       ///< one column or two; used where they are there
  std::vector<std::string> marks;    ///< columns without which it is not this format
  const char* unit = "";             ///< of all, where no head has one
  std::optional<bool> is_current, is_up;
  std::vector<LostRule> lost;  ///< of those columns that are there
  /// Lost points are there, and only those columns tell: without one the user must.
  bool needs_lost = false;
};

/// The first that fits is taken. What the programs leave open stays open: the unit of VIC's metric columns,
/// which way y_c of VIC-2D points.
const std::vector<ColumnFormat>& formats() {
  static const std::vector<std::string> k_vic_id{"x", "y"};
  static const std::vector<LostRule> k_sigma{{"sigma", "<", 0}};
  static const std::vector<ColumnFormat> k_formats{
      {"vic-3d", {"X", "Y", "U", "V"}, k_vic_id, {"sigma"}, "", false, true, k_sigma},
      {"vic-3d", {"X", "Y", "U", "V"}, k_vic_id, {"Z", "W"}, "", false, true, k_sigma, true},
      {"vic-2d", {"x_c", "y_c", "u_c", "v_c"}, k_vic_id, {}, "", false, {}, k_sigma, true},
      {"vic-2d", {"x", "y", "u", "v"}, {}, {"sigma"}, "px", false, false, k_sigma, true},
      {"matchid",
       {"coor.X", "coor.Y", "disp.Horizontal Displacement U", "disp.Vertical Displacement V"},
       {"Coordinates.Image X", "Coordinates.Image Y"},
       {},
       "",
       true,
       false,
       {}},
      {"matchid",
       {"Coordinates.Image X", "Coordinates.Image Y", "disp.Horizontal Displacement U",
        "disp.Vertical Displacement V"},
       {},
       {},
       "",
       false,
       false,
       {}},
      {"matchid", {"x", "y", "u", "v"}, {"x_pic", "y_pic"}, {"x_pic", "y_pic"}, "", true, false, {}},
      {"gom", {"x", "y", "displacement_x", "displacement_y"}, {"id"}, {"id"}, "", true, true, {}},
      {"aramis", {"x_undef", "y_undef", "u", "v"}, {"ID"}, {}, "", false, true, {}},
      {"davis", {"x", "y", "X-displacement", "Y-displacement"}, {}, {}, "", false, true, {}},
      {"davis", {"x", "y", "x-displacement", "y-displacement"}, {}, {}, "", false, true, {}},
      {"dice",
       {"COORDINATE_X", "COORDINATE_Y", "DISPLACEMENT_X", "DISPLACEMENT_Y"},
       {"SUBSET_ID"},
       {},
       "px",
       false,
       false,
       {{"SIGMA", "<", 0}, {"GAMMA", "<", 0}, {"BETA", "<", 0}, {"MATCH", "<", 0}, {"STATUS_FLAG", "!=", 4}},
       true},
      {"opencorr", {"x", "y", "u", "v"}, {}, {"ZNCC"}, "px", false, false, {{"ZNCC", "<", 0}}, true},
      {"pyvale",
       {"subset_x", "subset_y", "disp_u", "disp_v"},
       {},
       {},
       "px",
       false,
       false,
       {{"converged", "=", 0}},
       true},
      {"sun-dic", {"X Coord", "Y Coord", "X Disp", "Y Disp"}, {}, {}, "px", false, false, {}},
      {"gom", {"x", "y"}, {"id"}, {"id"}, "", true, true, {}},
  };
  return k_formats;
}

bool has(const FieldBlock& block, const std::string& name) {
  return std::find(block.names.begin(), block.names.end(), name) != block.names.end();
}

bool fits(const ColumnFormat& format, const FieldBlock& block) {
  const auto is_there = [&](const std::string& name) { return has(block, name); };
  return std::all_of(format.x_y_u_v.begin(), format.x_y_u_v.end(), is_there) &&
         std::all_of(format.marks.begin(), format.marks.end(), is_there);
}

/// Whether a block is one of points: it has the columns of the format, or those that are declared.
bool belongs(const ColumnFormat& format, const FieldMapping& mapping, const FieldBlock& block) {
  if (mapping.format != "table") return fits(format, block);
  for (const std::string& name : format.x_y_u_v) {
    const auto given = mapping.columns.find(name);
    std::string column = given == mapping.columns.end() ? name : given->second;
    if (column.starts_with('-') && !has(block, column)) column.erase(0, 1);
    if (!column.starts_with('#') && !has(block, column)) return false;
  }
  return true;
}

/// Columns of a block that is read, by their place.
class Columns {
 public:
  Columns(const FieldText& file, const FieldBlock& block) : file_(file), block_(block) {}

  /// The place of a column: its name, or "#3". A name that is there twice must mean the same numbers.
  [[nodiscard]] std::size_t index_of(const std::string& name) const {
    const auto& names = block_.names;
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      if (const auto number = file_.number(name.starts_with('#') ? name.substr(1) : "");
          number && *number >= 1 && *number <= double(width()))
        return std::size_t(*number) - 1;
      throw DataError(fmt::format(
          "{}: column {} is missing; there are: {}", file_.path, name,
          names.empty() ? "columns without names, #1 and so on" : fmt::format("{}", fmt::join(names, ", "))));
    }
    const std::size_t index = found - names.begin();
    const auto other = std::find(found + 1, names.end(), name);
    for (const FieldBlock::Row& row : block_.rows)
      if (other != names.end() && row.cells[index] != row.cells[other - names.begin()])
        file_.fail(row.line, fmt::format("two columns are named {} and differ: say which is meant in "
                                         "data.fields.columns, \"#{}\" or \"#{}\"",
                                         name, index + 1, other - names.begin() + 1));
    return index;
  }
  [[nodiscard]] double value(const FieldBlock::Row& row, std::size_t column) const {
    if (column >= row.cells.size())
      file_.fail(row.line, fmt::format("{} fields, column #{} is missing", row.cells.size(), column + 1));
    const auto number = file_.number(row.cells[column]);
    if (!number)
      file_.fail(row.line, fmt::format("column {}: \"{}\" is not a number",
                                       column < block_.names.size() ? block_.names[column]
                                                                    : fmt::format("#{}", column + 1),
                                       row.cells[column]));
    return std::isfinite(*number) ? *number : k_nan;
  }
  [[nodiscard]] std::string unit(std::size_t column) const {
    return column < block_.units.size() ? block_.units[column] : "";
  }

 private:
  [[nodiscard]] std::size_t width() const { return block_.rows.empty() ? 0 : block_.rows[0].cells.size(); }

  const FieldText& file_;
  const FieldBlock& block_;
};

/// "# Units: length:mm angle:deg time:s" has that of `what`.
std::string unit_of_comments(const FieldText& file, std::string_view what) {
  for (std::string_view comment : file.comments) {
    if (!comment.starts_with("Units:")) continue;
    const std::size_t at = comment.find(fmt::format("{}:", what));
    if (at == std::string_view::npos) continue;
    comment.remove_prefix(at + what.size() + 1);
    return std::string(comment.substr(0, comment.find(' ')));
  }
  return "";
}

double in_si(double value, const std::string& unit) {
  const auto known = unit_of(unit);
  return known ? value * known->factor : value;
}

/// Comments "name : value", "name : kind : value" and "name: value unit" of an ARAMIS nodemap.
void read_comment_values(const FieldText& file, ExportedField& field) {
  for (const std::string_view comment : file.comments) {
    const std::size_t first = comment.find(':'), last = comment.rfind(": ");  // not that of 09:25
    if (first == std::string_view::npos || first == 0 || last == std::string_view::npos) continue;
    const std::string name(comment.substr(0, comment.find_last_not_of(" \t", first - 1) + 1));
    std::string_view value = comment.substr(last + 2);
    const std::size_t blank = value.find(' ', value.find_first_not_of(' '));
    const std::string unit(blank == std::string_view::npos ? "" : value.substr(blank + 1));
    const auto number = file.number(value.substr(0, blank));
    if (!number || !std::isfinite(*number)) continue;
    field.scalars[name] = in_si(*number, unit);
    if (name == "current_stage_relative_date" || name == "Current stage relative date") field.time = *number;
  }
}

/// GOM has a table of one row before the points: stage, index, relative_time, date.
void read_stage(const FieldText& file, ExportedField& field) {
  for (const FieldBlock& block : file.blocks) {
    if (!has(block, "relative_time") || block.rows.size() != 1) continue;
    const Columns columns(file, block);
    const double time = columns.value(block.rows[0], columns.index_of("relative_time"));
    if (!std::isnan(time)) field.time = in_si(time, unit_of_comments(file, "time"));
  }
}

/// MatchID repeats "ext.Time [s]" and "ext.Force [N]" in each row.
void read_repeated(const FieldText& file, const FieldBlock& block, ExportedField& field) {
  const Columns columns(file, block);
  for (std::size_t c = 0; c < block.names.size(); ++c) {
    const std::string& name = block.names[c];
    if (!name.starts_with("ext.") || block.rows.empty()) continue;
    const double value = in_si(columns.value(block.rows[0], c), block.units[c]);
    if (std::isnan(value)) continue;
    (name == "ext.Time" ? field.time.emplace() : field.scalars[name]) = value;
  }
}

/// The roles of columns in one block: those of the format, or the user's.
struct Roles {
  std::array<std::size_t, 4> column{};
  std::array<double, 4> sign{1, 1, 1, 1};
  std::size_t count = 4;
  std::vector<std::size_t> id;
};

Roles roles_of(const ColumnFormat& format, const FieldMapping& mapping, const FieldBlock& block,
               const Columns& columns) {
  static constexpr std::array k_keys{"x", "y", "u", "v"};
  Roles roles;
  roles.count = format.x_y_u_v.size();
  for (std::size_t k = 0; k < 4; ++k) {
    const auto given = mapping.columns.find(k_keys[k]);
    if (given == mapping.columns.end() && k >= roles.count) continue;
    std::string name = given == mapping.columns.end() ? format.x_y_u_v[k] : given->second;
    if (given != mapping.columns.end() && name.starts_with('-') && !has(block, name))
      roles.sign[k] = -1, name.erase(0, 1);
    roles.column[k] = columns.index_of(name);
    roles.count = std::max(roles.count, k + 1);
  }
  if (const auto given = mapping.columns.find("id"); given != mapping.columns.end())
    roles.id = {columns.index_of(given->second)};
  else if (std::all_of(format.id.begin(), format.id.end(),
                       [&](const std::string& name) { return has(block, name); }))
    for (const std::string& name : format.id) roles.id.push_back(columns.index_of(name));
  return roles;
}

void read_rows(const FieldText& file, const FieldBlock& block, const Roles& roles,
               const std::vector<std::pair<std::size_t, LostRule>>& rules, ExportedField& field) {
  const Columns columns(file, block);
  for (const FieldBlock::Row& row : block.rows) {
    std::array<double, 4> value{};
    bool lost = false;
    for (std::size_t k = 0; k < roles.count; ++k) {
      value[k] = roles.sign[k] * columns.value(row, roles.column[k]);
      lost = lost || std::isnan(value[k]);
    }
    for (const auto& [column, rule] : rules) lost = lost || rule(columns.value(row, column));
    field.x.push_back(lost && roles.count == 2 ? k_nan : value[0]), field.y.push_back(value[1]);
    if (roles.count == 4)
      field.u.push_back(lost ? k_nan : value[2]), field.v.push_back(lost ? k_nan : value[3]);
    if (roles.id.empty()) continue;
    field.id.push_back(
        {columns.value(row, roles.id[0]), roles.id.size() > 1 ? columns.value(row, roles.id[1]) : 0});
    if (std::isnan(field.id.back()[0]) || std::isnan(field.id.back()[1]))
      file.fail(row.line, "the point has no number: the column that it is known by is empty here");
  }
}

const ColumnFormat& format_of(const FieldText& file, const FieldMapping& mapping) {
  static const ColumnFormat k_declared{"table", {"x", "y", "u", "v"}, {}, {}, "", {}, {}, {}, true};
  if (mapping.format == "table") return k_declared;
  for (const ColumnFormat& format : formats())
    if (mapping.format == "auto" || mapping.format == format.name)
      for (const FieldBlock& block : file.blocks)
        if (fits(format, block) &&
            (format.name != std::string("gom") || !unit_of_comments(file, "length").empty()))
          return format;
  std::vector<std::string> names;
  for (const FieldBlock& block : file.blocks)
    if (block.names.size() > names.size()) names = block.names;
  if (!names.empty() && names.front() == "FRAME")
    throw DataError(file.path + ": it is one subset over all frames: export the whole field of each frame");
  throw DataError(fmt::format(
      "{}: {}: give data.fields.format = \"table\" and in data.fields.columns which are x, y, u and v",
      file.path,
      names.empty() ? "a format that is not known, without names of columns"
      : mapping.format == "auto"
          ? fmt::format("its columns {} are those of no format that is known", fmt::join(names, ", "))
          : fmt::format("its columns {} are not those of {}", fmt::join(names, ", "), mapping.format)));
}

/// The rules whose columns are there. DataError where lost points are hidden among the others and none is.
std::vector<std::pair<std::size_t, LostRule>> rules_of(const FieldText& file, const ColumnFormat& format,
                                                       const FieldMapping& mapping, const FieldBlock& block,
                                                       const Columns& columns) {
  std::vector<std::pair<std::size_t, LostRule>> rules;
  if (mapping.lost) {
    for (const LostRule& rule : *mapping.lost) rules.emplace_back(columns.index_of(rule.column), rule);
    return rules;
  }
  // A flag has more values than success and failure: only where nothing else tells.
  for (const LostRule& rule : format.lost)
    if (has(block, rule.column) && (rule.compare != "!=" || rules.empty()))
      rules.emplace_back(columns.index_of(rule.column), rule);
  if (rules.empty() && format.needs_lost)
    throw DataError(fmt::format(
        "{}: {}: give data.fields.lost, such as [\"sigma < 0\"], or [] if rows of lost points are missing or "
        "have no numbers",
        file.path,
        format.lost.empty() ? "nothing says which points are lost"
                            : fmt::format("without a column {} it is not known which points are lost",
                                          format.lost[0].column)));
  return rules;
}

}  // namespace

std::vector<std::string> table_formats() {
  std::vector<std::string> names;
  for (const ColumnFormat& format : formats())
    if (names.empty() || std::find(names.begin(), names.end(), format.name) == names.end())
      names.emplace_back(format.name);
  return names;
}

ExportedField read_columns(const FieldText& file, const FieldMapping& mapping) {
  const ColumnFormat& format = format_of(file, mapping);
  ExportedField field;
  field.path = file.path, field.format = format.name;
  field.is_current = format.is_current, field.is_up = format.is_up;
  const std::string common = *format.unit != '\0' ? format.unit : unit_of_comments(file, "length");
  field.position_unit = field.displacement_unit = common;
  // Other positions than the format's are in a frame of their own.
  if (mapping.columns.contains("x") || mapping.columns.contains("y"))
    field.is_current.reset(), field.is_up.reset(), field.position_unit = field.displacement_unit = "";
  for (const FieldBlock& block : file.blocks) {
    if (!belongs(format, mapping, block)) {
      if (!field.x.empty())
        file.fail(block.line,
                  "neither numbers nor the columns of the table before: the file is damaged here");
      if (&block != &file.blocks.back()) continue;  // the last one's columns are missed with their names
    }
    if (block.rows.empty()) continue;
    const Columns columns(file, block);
    const Roles roles = roles_of(format, mapping, block, columns);
    if (const std::string unit = columns.unit(roles.column[0]); !unit.empty()) field.position_unit = unit;
    if (const std::string unit = columns.unit(roles.column[2]); !unit.empty() && roles.count == 4)
      field.displacement_unit = unit;
    const auto rules = rules_of(file, format, mapping, block, columns);
    for (const auto& [column, rule] : rules)
      if (const std::string text = fmt::format("{} {} {:g}", rule.column, rule.compare, rule.value);
          field.lost_by.find(text) == std::string::npos)
        field.lost_by += (field.lost_by.empty() ? "" : ", ") + text;
    read_rows(file, block, roles, rules, field);
    read_repeated(file, block, field);
  }
  if (field.id.size() != field.x.size()) field.id.clear();  // not all tables have them
  read_comment_values(file, field);
  read_stage(file, field);
  return field;
}

}  // namespace knothe::files
