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
  s.add("files", &G::files, "Folder of the fields, or folder and pattern of their names, `\"dic/*.csv\"`.",
        file, required);
  s.add("format", in(&G::mapping, &Mapping::format),
        fmt::format("`auto` (from the content), or: {}; `table`: what `columns` says.",
                    fmt::join(files::field_formats(), ", ")));
  s.table("columns", "Columns that are not the format's.");
  s.add("columns.*", in(&G::mapping, &Mapping::columns),
        "Column of x, y, u, v or id (the point's number): its name, or `#3` for the third; `-NAME` is its "
        "negative.");
  s.add("units", in(&G::mapping, &Mapping::units),
        "Unit of positions and displacements, if the files state none.");
  s.choice("positions", &G::positions, k_positions, "State that the positions belong to.");
  s.choice("y", &G::y, k_directions, "Direction of y and v.");
  s.add("lost", &G::lost, "Which points are lost, `[\"sigma < 0\"]`; `[]`: those without numbers alone.",
        no_default);
  s.add("grid", in(&G::mapping, &Mapping::grid),
        "Matrices: position of the first value and the steps, [x, y, dx, dy], in their unit.");
  s.add("reference", &G::reference, "File with the reference positions, where the others have none.", file);
}

void add_time_options(Section<G>& s) {
  s.add("times", &G::times, "Model time of each file, in the order of the numbers in their names.");
  s.add("steps", &G::steps, "Table of files (or numbers of images) with their times and series.", file);
  s.choice("time", &G::time_from_name, "stated", "name",
           "Otherwise: the time that the file states, or the number in its name.");
  s.add("time_zero", &G::time_zero, "Their time at the model's time 0.");
  s.table("series", "Series that files or steps state, such as a force.");
  s.add("series.*", &G::series, "Its name there, of the model's output of that name.");
}

void add_noise_options(Section<G>& s) {
  s.add("std", &G::std, "Standard deviation of a displacement, m.", positive);
  s.add("static", &G::static_fields,
        "Instead: names of fields of the body at rest, from which it is estimated.");
  s.add("min_distance", &G::min_distance,
        "Points closer to another are left out, m: subsets that overlap have errors in common.",
        non_negative);
  s.add("relative_scale_std", &G::relative_scale_std,
        "Standard deviation of the scale, relative (calibration, motion out of plane).", non_negative);
  s.add("motion_std", &G::motion_std,
        "Standard deviation of a rigid motion of each field, [m, degrees], which is integrated out.",
        of_shape("two numbers, [m, degrees]"));
}

void add_registration_options(Section<G>& s) {
  constexpr const char* k_points = "points of two numbers each, [[x, y], [x, y]]";
  s.add("scale", &G::scale, "Metres per pixel.", positive);
  s.add("points", &G::points, "Places in the field, as in its files, [[x, y], …] …", of_shape(k_points));
  s.add("model_points", &G::model_points, "… and on the model's face, [[right, up], …], m.",
        of_shape(k_points));
  s.add("origin", &G::origin, "Instead: where the model's origin is in the field, [x, y].",
        of_shape("two numbers, [x, y]"));
  s.add("angle", &G::angle, "By which the field is rotated relative to the model, degrees.");
  s.add("view", &G::view, "As `dic.view`.");
  s.add("plane", &G::plane, "As `dic.plane`.");
  s.add("region", &G::region, "Part of the face that is used, [right, up, right, up], m.",
        of_shape("two opposite corners, [right, up, right, up], m"));
}

const Section<G>& field_section() {
  static const Section<G> k_section(
      "data.fields",
      "Displacement fields that another program exported (docs/how-to/fields-of-other-programs.md).",
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
  if ((given.motion_std[0] < 0) || (given.motion_std[1] < 0))
    values.complain("data.fields.motion_std", "\"data.fields.motion_std\" is not negative");
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
  given.beside = values.resolved(values.get<std::string>("data.file"));
  return given;
}

}  // namespace knothe::project
