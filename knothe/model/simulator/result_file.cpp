#include "knothe/model/simulator/result_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/calculix.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/files/extension.hpp"
#include "knothe/files/npy.hpp"
#include "knothe/files/units.hpp"
#include "knothe/files/vtu_reader.hpp"
#include "knothe/model/grid/validation.hpp"

namespace knothe::model {
namespace {

/// "force [kN]": name and unit.
Quantity quantity_of(const std::string& header) {
  const std::size_t open = header.rfind(" [");
  if (open == std::string::npos || !header.ends_with("]")) return {header, "1"};
  return {header.substr(0, open), header.substr(open + 2, header.size() - open - 3)};
}

/// A column time, in s where it has a unit, and series beside it as they are (`settle_units`).
struct TimeTable {
  std::vector<double> time;
  std::string time_units;
  std::vector<Quantity> quantities;
  std::vector<std::vector<double>> series;
};

TimeTable read_time_table(const std::string& path) {
  const files::CsvTable table = files::CsvTable::read(path);
  TimeTable result;
  for (const std::string& header : table.header()) {
    Quantity quantity = quantity_of(header);
    std::vector<double> values = table.numbers(header);
    if (quantity.name == "time") {
      result.time = std::move(values);
      if (quantity.units != "1") result.time_units = quantity.units;
      if (const auto unit = files::unit_of(quantity.units)) {
        result.time_units = unit->si;
        for (double& time : result.time) time *= unit->factor;
      }
    } else {
      result.quantities.push_back(std::move(quantity));
      result.series.push_back(std::move(values));
    }
  }
  if (result.time.empty())
    throw DataError(path + ": there is no column \"time\", or no row: a row for each time is needed");
  if (result.series.empty()) throw DataError(path + ": there is no column beside \"time\"");
  return result;
}

/// A sensor or state each, without a place.
Snapshots from_csv(const std::string& path) {
  TimeTable table = read_time_table(path);
  Snapshots solution;
  solution.time = std::move(table.time);
  solution.time_units = std::move(table.time_units);
  for (Index t = 0; t < std::ssize(solution.time); ++t)
    for (const auto& series : table.series) solution.values.push_back(series[t]);
  solution.quantities = std::move(table.quantities);
  return solution;
}

void place_columns(const ResultOptions& options, std::size_t columns, const std::string& path,
                   Snapshots& solution) {
  if (!options.points.empty()) {
    const files::CsvTable table = files::CsvTable::read(options.points);
    const auto x = table.numbers("x"), y = table.numbers("y"), z = table.numbers("z");
    const auto component = table.texts("component");
    for (Index i = 0; i < std::ssize(x); ++i) {
      if (component[i].size() != 1 || component[i][0] < 'x' || component[i][0] > 'z')
        table.fail(i, "component", "a component is x, y or z, not \"" + component[i] + "\"");
      solution.dofs.add(std::array{x[i], y[i], z[i]}, component[i][0] - 'x');
    }
    return;
  }
  if (options.names.size() != columns)
    throw DataError(
        fmt::format("{}: {} columns, but [offline.command] names {}: give \"names\", or "
                    "\"points\", for each",
                    path, columns, options.names.size()));
  for (std::size_t i = 0; i < columns; ++i)
    solution.quantities.push_back({options.names[i], i < options.units.size() ? options.units[i] : "1"});
}

Snapshots from_npy(const ResultOptions& options, const std::string& path) {
  files::NpyArray array = files::read_npy(path);
  if (array.shape.size() == 1) array.shape.insert(array.shape.begin(), 1);
  if (array.shape.size() != 2 || array.values.empty())
    throw DataError(
        fmt::format("{}: an array of {} dimensions: [times, dofs] is needed", path, array.shape.size()));
  Snapshots solution;
  solution.values = std::move(array.values);
  solution.time = options.times;
  if (solution.time.size() != array.shape[0])
    throw DataError(fmt::format("{}: {} rows, but [offline.command] \"times\" has {}: a row for each time",
                                path, array.shape[0], solution.time.size()));
  place_columns(options, array.shape[1], path, solution);
  return solution;
}

/// The last two extents of /snapshots are time and dofs; a lift that may differ from run to run is not used.
Snapshots from_hdf5(const std::string& path) {
  Snapshots solution = read_solution(path);
  if (solution.grid_size() != 1)
    throw DataError(fmt::format("{}: a grid of {} points, not one solution", path, solution.grid_size()));
  solution.lift.clear();
  return solution;
}

/// Three components at each point.
void place_at(const std::vector<double>& points, Snapshots& solution) {
  for (std::size_t i = 0; i + 2 < points.size(); i += 3)
    for (std::int64_t component = 0; component < 3; ++component)
      solution.dofs.add(std::span<const double, 3>(points.data() + i, 3), component);
}

/// The wanted field, or that of a displacement, or the only one that is a vector.
const files::VtuField& field_of(const files::VtuContents& grid, const ResultOptions& options,
                                const std::string& path) {
  std::vector<std::string> names;
  const files::VtuField* vector = nullptr;
  std::size_t vectors = 0;
  for (const files::VtuField& field : grid.point_fields) {
    const bool is_usual = options.quantity.empty() && (field.name == "displacement" || field.name == "u" ||
                                                       field.name == "U" || field.name == "Displacement");
    if ((is_usual || field.name == options.quantity) && field.components == 3) return field;
    names.push_back(field.name);
    if (field.components == 3) vector = &field, ++vectors;
  }
  if (options.quantity.empty() && vectors == 1) return *vector;
  throw DataError(fmt::format(
      "{}: there is no field \"{}\" of three components on the points: [offline.command] \"quantity\" "
      "names it; the file has {}",
      path, options.quantity.empty() ? "displacement" : options.quantity,
      names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
}

/// What its values are to be multiplied by to be in m: where the file says a unit, it is one of length.
double factor_to_metres(const files::VtuField& field, const std::string& path) {
  if (field.units.empty()) return 1;
  const auto unit = files::unit_of(field.units);
  if (unit && unit->si == "m") return unit->factor;
  throw DataError(
      fmt::format("{}: the field {} is in \"{}\" (key UNITS_LABEL): a displacement in m, or in "
                  "another unit of length, is needed",
                  path, field.name, field.units));
}

/// Between the points of a mesh of one kind of cells values are interpolated.
std::optional<Mesh> mesh_of(const files::VtuContents& grid) {
  if (grid.types.empty()) return std::nullopt;
  const files::VtkCell cell = files::vtk_cell(grid.types[0]);
  const bool is_one_kind = std::all_of(grid.types.begin(), grid.types.end(),
                                       [&](std::int64_t type) { return type == grid.types[0]; });
  if (!is_one_kind || cell.points < 3 || grid.connectivity.size() != cell.points * grid.types.size())
    return std::nullopt;
  return Mesh{grid.points, grid.connectivity, cell.points, cell.name};
}

/// Adds the field of one file at its time; the first one has the mesh.
void add_vtu(const ResultOptions& options, const std::string& path, double time, Snapshots& solution) {
  const files::VtuContents grid = files::read_vtu(path);
  const files::VtuField& field = field_of(grid, options, path);
  if (solution.time.empty()) {
    place_at(grid.points, solution);
    solution.mesh = mesh_of(grid);
  }
  if (field.values.size() != solution.dofs.components.size())
    throw DataError(fmt::format("{}: {} values, the first file has {}: the mesh must stay the same", path,
                                field.values.size(), solution.dofs.components.size()));
  solution.time.push_back(time);
  const double factor = factor_to_metres(field, path);
  for (const double value : field.values) solution.values.push_back(factor * value);
}

Snapshots from_vtu(const ResultOptions& options, const std::string& path) {
  Snapshots solution;
  const auto time = options.times.size() == 1 ? options.times[0] : files::read_vtu(path).time.value_or(1.0);
  add_vtu(options, path, time, solution);
  return solution;
}

Snapshots from_pvd(const ResultOptions& options, const std::string& path) {
  Snapshots solution;
  for (const files::PvdEntry& entry : files::read_pvd(path))
    add_vtu(options, (std::filesystem::path(path).parent_path() / entry.file).string(), entry.time, solution);
  return solution;
}

/// CalculiX' numbers of element types are 1 to 10. Of its quadratic bricks the vertical edges come before
/// those on top, in VTK the other way round.
std::optional<Mesh> mesh_of(const files::FrdContents& contents) {
  if (contents.cells.empty()) return std::nullopt;
  static constexpr std::array<int, 11> vtk = {0, 12, 13, 10, 25, 0, 24, 5, 22, 9, 23};
  const int type = contents.cells[0].type;
  const files::VtkCell cell = files::vtk_cell(type > 0 && type < std::ssize(vtk) ? vtk[type] : 0);
  Mesh mesh{contents.points, {}, cell.points, cell.name};
  for (auto [other, nodes] : contents.cells) {
    if (cell.points == 0 || other != type || nodes.size() != cell.points) return std::nullopt;
    if (cell.points == 20) std::rotate(nodes.begin() + 12, nodes.begin() + 16, nodes.end());
    mesh.cells.insert(mesh.cells.end(), nodes.begin(), nodes.end());
  }
  return mesh;
}

Snapshots from_frd(const ResultOptions& options, const std::string& path) {
  const files::FrdContents contents = files::read_frd(path);
  const std::string wanted = options.quantity.empty() ? "DISP" : options.quantity;
  Snapshots solution;
  place_at(contents.points, solution);
  solution.mesh = mesh_of(contents);
  for (const files::FrdField& field : contents.fields) {
    if (field.name != wanted) continue;
    if (field.components.size() != 3)
      throw DataError(
          fmt::format("{}: {} has {} components, three are needed", path, wanted, field.components.size()));
    solution.time.push_back(field.time);
    solution.values.insert(solution.values.end(), field.values.begin(), field.values.end());
  }
  if (solution.time.empty())
    throw DataError(fmt::format("{}: there is no field {}: ask for it with *NODE FILE", path, wanted));
  return solution;
}

/// All series of the file, or those that `names` asks for.
Snapshots from_dat(const ResultOptions& options, const std::string& path) {
  const files::DatContents contents = files::read_dat(path);
  std::vector<std::string> there;
  for (const files::DatSeries& series : contents.series) there.push_back(series.name);
  const std::vector<std::string>& wanted = options.names.empty() ? there : options.names;
  std::vector<const files::DatSeries*> chosen;
  Snapshots solution;
  solution.time = contents.time;
  for (Index i = 0; i < std::ssize(wanted); ++i) {
    const auto found = std::find(there.begin(), there.end(), wanted[i]);
    if (found == there.end())
      throw DataError(fmt::format("{}: there is no \"{}\" of [offline.command] \"names\"{}", path, wanted[i],
                                  did_you_mean(wanted[i], there)));
    chosen.push_back(&contents.series[found - there.begin()]);
    solution.quantities.push_back({wanted[i], i < std::ssize(options.units) ? options.units[i] : "1"});
  }
  for (Index t = 0; t < std::ssize(contents.time); ++t)
    for (const files::DatSeries* series : chosen) solution.values.push_back(series->values[t]);
  return solution;
}

void add_outputs(const std::string& path, Snapshots& solution) {
  TimeTable table = read_time_table(path);
  if (table.time.size() != solution.time.size())
    throw DataError(fmt::format("{}: it has {}, the field {}: the same times are needed", path,
                                counted(table.time.size(), "time"), solution.time.size()));
  const auto [other, of_field] = std::mismatch(table.time.begin(), table.time.end(), solution.time.begin());
  if (other != table.time.end())
    throw DataError(
        fmt::format("{}: the time of row {} is {}, that of the field {}: the same times, to the "
                    "last digit, are needed",
                    path, other - table.time.begin() + 1, *other, *of_field));
  for (Index k = 0; k < std::ssize(table.series); ++k)
    solution.outputs.push_back({table.quantities[k].name,
                                {table.quantities[k].units, table.quantities[k].name},
                                std::move(table.series[k])});
}

Snapshots read_field(const ResultOptions& options, const std::string& path) {
  if (files::extension_of(path) == ".csv") return from_csv(path);
  if (path.ends_with(".npy")) return from_npy(options, path);
  if (path.ends_with(".h5") || path.ends_with(".hdf5")) return from_hdf5(path);
  if (path.ends_with(".vtu")) return from_vtu(options, path);
  if (path.ends_with(".pvd")) return from_pvd(options, path);
  if (path.ends_with(".frd")) return from_frd(options, path);
  if (path.ends_with(".dat")) return from_dat(options, path);
  throw ProjectError(
      fmt::format("[offline.command]: field = \"{}\": the ending of the file is .csv, .npy, .h5, .vtu, .pvd, "
                  ".frd or .dat",
                  options.field));
}

}  // namespace

void settle_units(Snapshots& solution, const std::string& where) {
  for (SnapshotOutput& output : solution.outputs) {
    const auto unit = files::unit_of(output.labels.units);
    if (!unit) continue;
    output.labels.units = unit->si;
    for (double& value : output.values) value *= unit->factor;
  }
  const std::size_t n = solution.quantities.size();
  Validation(where).quantities(solution.quantities, n);
  for (std::size_t k = 0; k < n; ++k) {
    const auto unit = files::unit_of(solution.quantities[k].units);
    if (!unit) continue;
    solution.quantities[k].units = unit->si;
    if (unit->factor == 1) continue;
    for (std::size_t i = k; i < solution.values.size(); i += n) solution.values[i] *= unit->factor;
  }
}

void state_time_units(Snapshots& solution, const std::string& units) {
  if (!solution.time_units.empty()) return;
  const auto known = files::unit_of(units);
  solution.time_units = known ? known->si : units;
  for (double& time : solution.time) time *= known ? known->factor : 1;
}

Snapshots read_result(const ResultOptions& options, const std::string& folder) {
  const std::string path = (std::filesystem::path(folder) / options.field).string();
  if (!std::filesystem::exists(path))
    throw DataError(fmt::format("the run has ended well but left no {}", options.field));
  Snapshots solution = read_field(options, path);
  state_time_units(solution, options.time_units);
  if (!options.outputs.empty())
    add_outputs((std::filesystem::path(folder) / options.outputs).string(), solution);
  settle_units(solution, path);
  return solution;
}

}  // namespace knothe::model
