#include "knothe/project/field_options.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/error.hpp"
#include "knothe/imaging/series/series_names.hpp"
#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

/// What the file says; a FieldOptions is made of it.
struct Given : FieldOptions {
  std::optional<bool> positions, y;
  std::vector<std::string> lost;
};

using G = Given;
using Mapping = files::FieldMapping;

constexpr auto k_positions =
    std::to_array<Named<std::optional<bool>>>({{false, "reference"}, {true, "current"}});
constexpr auto k_directions = std::to_array<Named<std::optional<bool>>>({{true, "up"}, {false, "down"}});

void add_format_options(Section<G>& s) {
  s.add("files", &G::files, "Folder, or folder and pattern, `\"dic/*.csv\"`.", file, required);
  s.add("format", in(&G::mapping, &Mapping::format),
        "Found by itself, or its name; `table`: by `columns` alone.");
  s.table("columns", "Columns, where not the format's.");
  s.add("columns.*", in(&G::mapping, &Mapping::columns),
        "Column of x, y, u, v or id: name, `#3`, or `-NAME`.");
  s.add("units", in(&G::mapping, &Mapping::units), "Unit, where the files state none.");
  s.choice("positions", &G::positions, k_positions, "State in which positions are.");
  s.choice("y", &G::y, k_directions, "Direction of y and v.");
  s.add("lost", &G::lost, "Rules for lost points, `[\"sigma < 0\"]`.", no_default);
  s.add("grid", in(&G::mapping, &Mapping::grid), "Of matrices: [x, y, dx, dy].");
  s.add("reference", &G::reference, "File with the reference positions.", file);
}

void add_time_options(Section<G>& s) {
  s.add("times", &G::times, "Model times of the files.");
  s.add("steps", &G::steps, "Or a table: time, file (or image), series.", file);
  s.choice("time", &G::time_from_name, "stated", "name",
           "Or what the files state; the number in their names.");
  s.add("time_zero", &G::time_zero, "Subtracted from these.");
  s.table("series", "Series in files or steps.");
  s.add("series.*", &G::series, "Name there of this output.");
}

void add_noise_options(Section<G>& s) {
  s.add("std", &G::std, "Standard deviation of displacements, m.", positive);
  s.add("static", &G::static_fields, "Or names of fields at rest.");
  s.add("min_distance", &G::min_distance, "Least distance of points, m.", non_negative);
  s.add("outliers", &G::outliers,
        "Displacements are lost that differ from their neighbours by this many times the usual spread (5 is "
        "usual); 0: none.",
        non_negative);
  s.add("relative_scale_std", &G::relative_scale_std, "Relative standard deviation of the scale.",
        non_negative);
  s.add("motion_std", &G::motion_std,
        "Standard deviation of each field's rigid motion, [m, degrees], or [m, degrees, relative] with that "
        "out "
        "of plane, towards one camera: over its distance.");
}

void add_registration_options(Section<G>& s) {
  constexpr const char* k_points = "points of two numbers each, [[x, y], [x, y]]";
  s.add("scale", &G::scale, "Metres per pixel.", positive);
  s.add("points", &G::points, "Places in the field …", of_shape(k_points));
  s.add("model_points", &G::model_points, "… and on the model's face, m.", of_shape(k_points));
  s.add("origin", &G::origin, "Or the model's origin in the field.", of_shape("two numbers, [x, y]"));
  s.add("angle", &G::angle, "As `dic.angle`.");
  s.add("view", &G::view, "As `dic.view`.");
  s.add("plane", &G::plane, "As `dic.plane`.");
  s.add("region", &G::region, "Part of the face used, two corners, m.",
        of_shape("two opposite corners, [right, up, right, up], m"));
}

const Section<G>& field_section() {
  static const Section<G> k_section("data.fields",
                                    "Exported displacement fields (docs/how-to/fields-of-other-programs.md).",
                                    [](Section<G>& s) {
                                      add_format_options(s);
                                      add_time_options(s);
                                      add_noise_options(s);
                                      add_registration_options(s);
                                    });
  return k_section;
}

void check_mapping(Values& values, const Given& given, Mapping& mapping) {
  const std::vector<std::string> formats = files::field_formats();
  if (mapping.format != "auto" && std::find(formats.begin(), formats.end(), mapping.format) == formats.end())
    values.complain("data.fields.format",
                    fmt::format("\"data.fields.format\" must be \"auto\" or one of {}, not \"{}\"",
                                fmt::join(formats, ", "), mapping.format));
  for (const auto& [role, column] : mapping.columns)
    if (role != "x" && role != "y" && role != "u" && role != "v" && role != "id")
      values.complain("data.fields.columns." + role, fmt::format("\"{}\" is none of x, y, u, v, id", role));
  mapping.is_current = given.positions, mapping.is_up = given.y;
  if (!values.has("data.fields.lost")) return;
  mapping.lost.emplace();
  try {
    for (const std::string& rule : given.lost) mapping.lost->push_back(files::lost_rule(rule));
  } catch (const UsageError& error) {
    values.complain("data.fields.lost", error.what());
  }
}

/// What cannot be told without: where the field is in the model, and how well it is measured.
void check_rest(Values& values, const Given& given) {
  const bool by_points = values.has("data.fields.points") || values.has("data.fields.model_points");
  if (!by_points && !given.origin)
    values.complain("data.fields",
                    "[data.fields] does not say where the field is in the model: give \"points\" and "
                    "\"model_points\", or \"origin\" (and \"angle\"); [0, 0] where both have one origin");
  if (by_points && (given.origin || values.has("data.fields.angle")))
    values.complain("data.fields.points",
                    "\"points\" and \"model_points\" give origin and angle: leave those out");
  if (by_points && (given.points.size() < 2 || given.points.size() != given.model_points.size()))
    values.complain("data.fields.points",
                    "at least two \"points\" (better three) and as many \"model_points\" are needed");
  if (given.std.has_value() == !given.static_fields.empty())
    values.complain(
        "data.fields",
        "[data.fields] needs \"std\" or \"static\", one of the two: how well displacements are measured");
  if (given.motion_std.size() < 2 || given.motion_std.size() > 3 || std::ranges::min(given.motion_std) < 0)
    values.complain(
        "data.fields.motion_std",
        "\"data.fields.motion_std\" must be [m, degrees] or [m, degrees, relative], none negative");
  if (!given.times.empty() + !given.steps.empty() + given.time_from_name > 1)
    values.complain("data.fields",
                    "\"times\", \"steps\" and \"time\" = \"name\" all give the times: one of them is enough");
}

}  // namespace

std::vector<Option> field_option_table() {
  return joined(field_section());
}

FieldOptions read_field_options(Values& values) {
  if (!values.has_table("data.fields")) return {};
  Given given = field_section().read(values);
  if (values.has("data.pictures"))
    values.complain("data.fields",
                    "[data.fields] and \"data.pictures\" both say what was measured: give one");
  check_mapping(values, given, given.mapping);
  check_rest(values, given);
  given.motion_std.resize(3);
  return given;
}

}  // namespace knothe::project
