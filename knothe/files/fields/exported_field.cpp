#include "knothe/files/fields/exported_field.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/fields/field_formats.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/files/units.hpp"

namespace knothe::files {
namespace {

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

std::string first_bytes(const std::string& path, std::size_t count) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw DataError(path + ": cannot be read");
  std::string bytes(count, '\0');
  in.read(bytes.data(), std::ssize(bytes));
  bytes.resize(in.gcount());
  return bytes;
}

/// "name_U[mm].csv": a matrix of that quantity.
bool is_matrix(const std::string& path, const char* quantity) {
  return std::filesystem::path(path).filename().string().find(fmt::format("_{}[", quantity)) !=
         std::string::npos;
}

std::string detected_format(const std::string& path) {
  const std::string bytes = first_bytes(path, 520);
  if (is_matrix(path, "U")) return "matchid-matrix";
  if (bytes.starts_with("MATLAB") && bytes.find("HDF") == std::string::npos) return "vic-mat";
  if (path.ends_with(".dic2d")) return "pyvale-binary";
  const bool is_hdf5 = bytes.starts_with("\x89HDF") ||
                       bytes.substr(std::min<std::size_t>(512, bytes.size())).starts_with("\x89HDF");
  if (!is_hdf5) return "text";
  if (bytes.starts_with("MATLAB")) return "vic-mat";
  const Hdf5Reader file(path);
  if (file.has("/vector/coordinates")) return "dic-exchange";
  if (file.has("/displacements/displacement_x")) return "istra4d";
  throw DataError(path + ": HDF5 that is neither of Istra4D nor of DIC Exchange: export a table (CSV)");
}

ExportedField read_text_field(const std::string& path, const FieldMapping& mapping) {
  const FieldText file = read_field_text(path);
  const bool any = mapping.format == "auto" || mapping.format == "text";
  if (mapping.format == "davis-text" ||
      (any && !file.comments.empty() && file.comments[0].starts_with("DaVis")))
    return read_davis_text(file, mapping);
  if (mapping.format == "aramis-text" ||
      (any && std::any_of(file.comments.begin(), file.comments.end(),
                          [](std::string_view comment) { return comment.starts_with("Index_x"); })))
    return read_aramis_text(file);
  return read_columns(file, mapping);
}

/// Factor from `unit` to that of the common form, "px" or "mm".
double factor_of(const std::string& unit, const std::string& path) {
  std::string lower = unit;
  std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) { return std::tolower(c); });
  if (lower == "px" || lower == "pixel" || lower == "pixels") return 1;
  const auto known = unit_of(unit);
  if (known && known->si == "m") return known->factor * 1e3;
  throw DataError(
      fmt::format("{}: \"{}\" is no unit of a displacement: a length such as mm, or px", path, unit));
}

bool is_px(const std::string& unit) {
  return unit.starts_with("p") || unit.starts_with("P");
}

double settle_unit(const FieldMapping& mapping, const char* what, const ExportedField& field,
                   std::string& unit, std::vector<double>& first, std::vector<double>& second) {
  if (unit.empty()) unit = mapping.units;
  if (unit.empty())
    throw DataError(
        fmt::format("{}: {} does not say the unit of its {}: give data.fields.units, \"mm\" or another",
                    field.path, field.format, what));
  const double factor = factor_of(unit, field.path);
  for (auto* values : {&first, &second})
    for (double& value : *values) value *= factor;
  unit = is_px(unit) ? "px" : "mm";
  return factor;
}

/// Before units and directions are brought into the common form.
std::string words_for(const FieldMapping& mapping, const ExportedField& f) {
  const std::size_t points = f.x.size(), lost = f.lost_count();
  const auto stated = [&](const std::string& unit) { return unit.empty() ? mapping.units : unit; };
  std::string unit = stated(f.position_unit);
  if (stated(f.displacement_unit) != unit) unit += " and " + stated(f.displacement_unit);
  return fmt::format("{}, {}, {} lost{}, {}, positions of the {}, y {}", f.format, counted(points, "point"),
                     lost, lost == 0 || f.lost_by.empty() ? "" : fmt::format(" ({})", f.lost_by), unit,
                     *f.is_current ? "loaded state" : "reference", *f.is_up ? "up" : "down");
}

/// What `of` has for each point of `field`: by its id. NaN where it has not.
void from_reference(const ExportedField& of, const ExportedField& field, std::vector<double>& x,
                    std::vector<double>& y) {
  if (of.id.empty() || field.id.empty())
    throw DataError(
        fmt::format("{}: its points have no numbers by which those of {} are found: give "
                    "data.fields.columns.id",
                    field.path, of.path));
  std::map<std::array<double, 2>, std::size_t> place;
  for (std::size_t i = 0; i < of.id.size(); ++i) place[of.id[i]] = i;
  x.assign(field.id.size(), k_nan), y = x;
  for (std::size_t i = 0; i < field.id.size(); ++i)
    if (const auto found = place.find(field.id[i]); found != place.end())
      x[i] = of.x[found->second], y[i] = of.y[found->second];
}

}  // namespace

bool LostRule::operator()(double of_point) const {
  if (std::isnan(of_point)) return true;
  return compare == "<"   ? of_point < value
         : compare == ">" ? of_point > value
                          : (of_point == value) == (compare == "=");
}

LostRule lost_rule(const std::string& text) {
  const std::size_t at = text.find_first_of("<>=!");
  if (at != std::string::npos && at > 0) {
    const std::size_t end = text.find_first_not_of("<>=!", at);
    const std::string compare = text.substr(at, end == std::string::npos ? end : end - at);
    const auto value = parse_number(end == std::string::npos ? "" : text.substr(end));
    const std::string column = text.substr(0, text.find_last_not_of(' ', at - 1) + 1);
    if (value && !column.empty() && (compare == "<" || compare == ">" || compare == "=" || compare == "!="))
      return {column, compare, *value};
  }
  throw UsageError(fmt::format("\"{}\" is no rule: COLUMN < NUMBER, with <, >, = or !=", text));
}

std::size_t ExportedField::lost_count() const {
  const std::vector<double>& told = u.empty() ? x : u;
  return std::count_if(told.begin(), told.end(), [](double value) { return std::isnan(value); });
}

std::vector<std::string> field_formats() {
  std::vector<std::string> names = table_formats();
  names.insert(names.end(), {"davis-text", "aramis-text", "matchid-matrix", "pyvale-binary", "vic-mat",
                             "istra4d", "dic-exchange", "table"});
  return names;
}

bool is_second_matrix(const std::string& path) {
  return is_matrix(path, "V");
}

std::vector<ExportedField> read_exported_fields(const std::string& path, const FieldMapping& mapping) {
  const std::string format = mapping.format == "auto" ? detected_format(path) : mapping.format;
  if (format == "dic-exchange") return read_dic_exchange(path);
  if (format == "matchid-matrix") return {read_matchid_matrix(path, mapping.grid)};
  if (format == "vic-mat") return {read_vic_mat(path)};
  if (format == "pyvale-binary") return {read_pyvale_binary(path)};
  if (format == "istra4d") return {read_istra(path)};
  return {read_text_field(path, mapping)};
}

void settle_field(const FieldMapping& mapping, const ExportedField* reference, ExportedField& f) {
  if (mapping.is_current) f.is_current = mapping.is_current;
  if (mapping.is_up) f.is_up = mapping.is_up;
  const std::string needs = f.x.empty() ? "positions" : f.u.empty() ? "displacements" : "";
  if (!needs.empty() && reference == nullptr)
    throw DataError(fmt::format(
        "{}: it has no {}: give data.fields.reference, the file of the unloaded state", f.path, needs));
  if (f.x.empty()) {
    from_reference(*reference, f, f.x, f.y);
    f.position_unit = reference->position_unit, f.is_current = false;
  } else if (f.u.empty()) {
    std::vector<double> x, y;
    from_reference(*reference, f, x, y);
    f.u = f.x, f.v = f.y;
    for (std::size_t i = 0; i < x.size(); ++i) f.u[i] -= x[i], f.v[i] -= y[i];
    f.x = std::move(x), f.y = std::move(y);
    f.displacement_unit = f.position_unit, f.is_current = false;
  }
  if (!f.is_current)
    throw DataError(
        fmt::format("{}: {} does not say whether positions are those of the reference or of the "
                    "loaded state: give data.fields.positions, \"reference\" or \"current\"",
                    f.path, f.format));
  if (!f.is_up)
    throw DataError(
        fmt::format("{}: {} does not say whether y and v point up or down: give data.fields.y, "
                    "\"up\" or \"down\"",
                    f.path, f.format));
  for (std::size_t i = 0; i < f.x.size(); ++i)
    if (std::isnan(f.x[i] + f.y[i] + f.u[i] + f.v[i])) f.u[i] = f.v[i] = k_nan;
  f.found = words_for(mapping, f);
  f.position_factor = settle_unit(mapping, "positions", f, f.position_unit, f.x, f.y);
  (void)settle_unit(mapping, "displacements", f, f.displacement_unit, f.u, f.v);
  if (*f.is_current && f.position_unit != f.displacement_unit)
    throw DataError(
        fmt::format("{}: positions of the loaded state in {}, displacements in {}: the reference "
                    "is not known; export both in one unit",
                    f.path, f.position_unit, f.displacement_unit));
  for (std::size_t i = 0; i < f.x.size(); ++i) {
    if (*f.is_current) f.x[i] -= f.u[i], f.y[i] -= f.v[i];
    if (*f.is_up) f.y[i] = -f.y[i], f.v[i] = -f.v[i];
  }
}

}  // namespace knothe::files
