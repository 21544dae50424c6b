#include "knothe/project/field_steps.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/fields/field_text.hpp"
#include "knothe/files/units.hpp"

namespace knothe::project {
namespace {

using files::ExportedField;

std::string name_of(const std::string& path) {
  return path.substr(path.find_last_of("/\\") + 1);  // also of another system
}

/// Numbers in a name, "12.500" as one.
std::vector<double> numbers_in(const std::string& name) {
  std::vector<double> numbers;
  for (std::size_t at = 0; at < name.size();) {
    if (std::isdigit(static_cast<unsigned char>(name[at])) == 0) {
      ++at;
      continue;
    }
    double value = 0;
    const auto end =
        std::from_chars(name.data() + at, name.data() + name.size(), value, std::chars_format::fixed).ptr;
    numbers.push_back(value);
    at = end - name.data();
  }
  return numbers;
}

bool matches(std::string_view name, std::string_view pattern) {
  if (pattern.empty()) return name.empty();
  if (pattern[0] == '*')
    return matches(name, pattern.substr(1)) || (!name.empty() && matches(name.substr(1), pattern));
  return !name.empty() && (pattern[0] == '?' || pattern[0] == name[0]) &&
         matches(name.substr(1), pattern.substr(1));
}

/// The number of each name: the one that is not the same in all.
std::vector<double> numbers_of_names(const std::vector<ExportedField>& fields) {
  std::vector<std::vector<double>> all;
  for (const ExportedField& field : fields) all.push_back(numbers_in(name_of(field.path)));
  std::vector<std::size_t> places;
  for (std::size_t k = 0; k < all[0].size(); ++k)
    if (all.size() == 1 || std::any_of(all.begin(), all.end(),
                                       [&](const auto& n) { return n.size() <= k || n[k] != all[0][k]; }))
      places.push_back(k);
  const bool alike =
      std::all_of(all.begin(), all.end(), [&](const auto& n) { return n.size() == all[0].size(); });
  if (places.size() != 1 || !alike)
    throw DataError(
        fmt::format("{}: {} of the numbers in its name tell the step: give data.fields.times, or a table "
                    "data.fields.steps",
                    fields[0].path, places.empty() ? "none" : "several"));
  std::vector<double> numbers;
  for (const auto& of_name : all) numbers.push_back(of_name[places[0]]);
  return numbers;
}

/// A table of steps: which file or image, when, and what was measured then.
class StepTable {
 public:
  explicit StepTable(const std::string& path) : text_(files::read_field_text(path)) {
    if (text_.blocks.empty() || text_.blocks[0].names.empty() || text_.blocks[0].rows.empty())
      throw DataError(path + ": a table with a head is needed: time,file");
    for (std::size_t c = 0; c < block().names.size(); ++c) {
      std::string name = block().names[c];
      std::transform(name.begin(), name.end(), name.begin(),
                     [](unsigned char letter) { return std::tolower(letter); });
      if (!time_ && name.starts_with("time")) time_ = c;
      if (!file_ && (name.starts_with("file") || name.starts_with("image"))) file_ = c;
    }
    if (!time_ || !file_)
      throw DataError(fmt::format(
          "{}: {} is missing: columns time and file (or image, its number) are needed; there are: {}", path,
          time_ ? "file" : "time", fmt::join(block().names, ", ")));
  }

  void tell(const FieldOptions& options, std::vector<ExportedField>& fields) const {
    std::vector<double> numbers;
    for (ExportedField& field : fields) {
      const files::FieldBlock::Row* found = nullptr;
      for (const auto& row : block().rows)
        if (is_of(row, field.path, numbers, fields)) found = &row;
      if (found == nullptr)
        throw DataError(fmt::format("{}: no row for the field {}", text_.path, name_of(field.path)));
      field.time = number(*found, *time_);
      for (const auto& [name, column] : options.series)
        if (const auto c = column_of(column)) field.scalars[column] = number(*found, *c);
    }
  }

 private:
  [[nodiscard]] const files::FieldBlock& block() const { return text_.blocks[0]; }

  [[nodiscard]] double number(const files::FieldBlock::Row& row, std::size_t column) const {
    const auto value = text_.number(row.cells[column]);
    if (!value || (column == *time_ && std::isnan(*value)))
      text_.fail(row.line,
                 fmt::format("column {}: \"{}\" is not a number", block().names[column], row.cells[column]));
    const auto unit = files::unit_of(block().units[column]);
    return unit ? *value * unit->factor : *value;
  }

  /// By name, or where two have it by name and unit: "Force [N]".
  [[nodiscard]] std::optional<std::size_t> column_of(const std::string& name) const {
    std::optional<std::size_t> found;
    for (std::size_t c = 0; c < block().names.size(); ++c) {
      if (name == fmt::format("{} [{}]", block().names[c], block().units[c])) return c;
      if (name != block().names[c]) continue;
      if (found)
        throw DataError(fmt::format("{}: two columns are named {}: write it with its unit, \"{} [{}]\"",
                                    text_.path, name, name, block().units[c]));
      found = c;
    }
    return found;
  }

  /// A file is named with the picture's name or its own; an image by its number.
  bool is_of(const files::FieldBlock::Row& row, const std::string& path, std::vector<double>& numbers,
             const std::vector<ExportedField>& fields) const {
    const std::string listed = name_of(std::string(row.cells[*file_])), name = name_of(path);
    if (listed.empty()) return false;
    const auto number = text_.number(listed);
    if (!number) {
      const std::string stem = listed.substr(0, listed.rfind('.'));
      return name == listed || name.starts_with(listed + ".") || name.substr(0, name.rfind('.')) == stem;
    }
    if (fields.size() == 1) {
      const std::vector<double> in_name = numbers_in(name);
      return std::find(in_name.begin(), in_name.end(), *number) != in_name.end();
    }
    if (numbers.empty()) numbers = numbers_of_names(fields);
    for (std::size_t k = 0; k < fields.size(); ++k)
      if (fields[k].path == path) return numbers[k] == *number;
    return false;
  }

  files::FieldText text_;
  std::optional<std::size_t> time_, file_;
};

}  // namespace

std::string fields_folder(const FieldOptions& options) {
  const bool is_pattern =
      std::filesystem::path(options.files).filename().string().find_first_of("*?") != std::string::npos;
  return is_pattern ? std::filesystem::path(options.files).parent_path().string() : options.files;
}

std::vector<std::string> list_fields(const std::string& files) {
  namespace fs = std::filesystem;
  std::error_code error;
  const bool is_folder = fs::is_directory(files, error);
  const fs::path folder = is_folder ? fs::path(files) : fs::path(files).parent_path();
  const std::string pattern = is_folder ? "*" : fs::path(files).filename().string();
  std::vector<std::string> paths;
  for (const auto& entry : fs::directory_iterator(folder.empty() ? fs::path(".") : folder, error)) {
    const std::string name = entry.path().filename().string();
    if (!entry.is_directory() && name[0] != '.' && matches(name, pattern) && !files::is_second_matrix(name))
      paths.push_back((folder / name).string());
  }
  if (error)
    throw DataError(fmt::format("{}: the folder cannot be read: {}", folder.string(), error.message()));
  if (paths.empty()) throw DataError(fmt::format("{}: no file is there", files));
  std::sort(paths.begin(), paths.end(), [](const std::string& a, const std::string& b) {
    return std::pair(numbers_in(name_of(a)), a) < std::pair(numbers_in(name_of(b)), b);
  });
  return paths;
}

void tell_times(const FieldOptions& options, std::span<const double> model_times,
                std::vector<ExportedField>& fields) {
  if (!options.times.empty() && options.times.size() != fields.size())
    throw DataError(fmt::format("{}: data.fields.times has {} times for {}", options.files,
                                options.times.size(), counted(fields.size(), "field")));
  if (!options.steps.empty()) StepTable(options.steps).tell(options, fields);
  if (options.time_from_name) {
    const std::vector<double> numbers = numbers_of_names(fields);
    for (std::size_t k = 0; k < fields.size(); ++k) fields[k].time = numbers[k];
  }
  for (std::size_t k = 0; k < fields.size(); ++k) {
    if (!options.times.empty()) fields[k].time = options.times[k];
    if (!fields[k].time && fields.size() == 1 && model_times.size() == 1)
      fields[k].time = model_times[0] + options.time_zero;
    if (!fields[k].time)
      throw DataError(
          fmt::format("{}: {} does not say its time: give data.fields.times, a table data.fields.steps "
                      "(time,file), or data.fields.time = \"name\" for the number in the name",
                      fields[k].path, fields[k].format));
    *fields[k].time -= options.time_zero;
  }
  std::stable_sort(fields.begin(), fields.end(),
                   [](const auto& a, const auto& b) { return *a.time < *b.time; });
  for (std::size_t k = 1; k < fields.size(); ++k)
    if (*fields[k].time == *fields[k - 1].time)
      throw DataError(
          fmt::format("{}: the same time, {}, as {}", fields[k].path, *fields[k].time, fields[k - 1].path));
}

}  // namespace knothe::project
