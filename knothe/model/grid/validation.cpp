#include "knothe/model/grid/validation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/units.hpp"

namespace knothe::model {

namespace {

std::string full_index(std::size_t position, const files::Shape& shape) {
  files::Shape index(shape.size());
  for (std::size_t k = shape.size(); k-- > 0;) {
    index[k] = position % shape[k];
    position /= shape[k];
  }
  return fmt::format("[{}]", fmt::join(index, ","));
}

}  // namespace

void Validation::fail(const std::string& what) const {
  throw DataError(fmt::format("{}: {}", where_, what));
}

void Validation::array(const std::string& name, std::span<const double> values,
                       const files::Shape& shape) const {
  if (values.size() != product(shape)) {
    fail(fmt::format("{} has {} entries, shape ({}) needs {}", name, values.size(), fmt::join(shape, ", "),
                     product(shape)));
  }
  const auto bad = std::find_if(values.begin(), values.end(), [](double v) { return !std::isfinite(v); });
  if (bad != values.end()) {
    fail(fmt::format("{}{} is {}: only finite numbers are allowed here", name,
                     full_index(bad - values.begin(), shape), std::isnan(*bad) ? "NaN" : "infinite"));
  }
}

void Validation::increasing(const std::string& name, std::span<const double> values) const {
  array(name, values, {values.size()});
  for (Index i = 1; i < std::ssize(values); ++i) {
    if (!(values[i] > values[i - 1])) {
      fail(fmt::format("{} is not strictly increasing: {}[{}] = {} after {}", name, name, i, values[i],
                       values[i - 1]));
    }
  }
}

void Validation::axes(std::span<const Axis> axes, std::size_t minimum_nodes) const {
  require(!axes.empty(), "attribute parameters of / names no parameter: at least one is needed");
  std::set<std::string> names;
  for (const Axis& axis : axes) {
    require(!axis.name.empty(), "attribute parameters of / has an empty name");
    require(names.insert(axis.name).second, fmt::format("parameter {} is named twice", axis.name));
    require(axis.nodes.size() >= minimum_nodes,
            fmt::format("/parameters/{} has {} node(s): at least {} are needed", axis.name, axis.nodes.size(),
                        minimum_nodes));
    increasing("/parameters/" + axis.name, axis.nodes);
  }
}

void Validation::dofs(const Dofs& dofs, std::size_t dof_count) const {
  if (dofs.empty() && dofs.points.empty()) return;
  require(dofs.components.size() == dof_count,
          fmt::format("/dofs/component has {} entries, the field has {} dofs", dofs.components.size(),
                      dof_count));
  array("/dofs/points", dofs.points, {dof_count, 3});
  for (std::size_t i = 0; i < dof_count; ++i) {
    require(dofs.components[i] >= 0 && dofs.components[i] <= 2,
            fmt::format("/dofs/component[{}] is {}: 0 (x), 1 (y) or 2 (z) is needed", i, dofs.components[i]));
  }
}

void Validation::quantities(std::span<const Quantity> quantities, std::size_t dof_count) const {
  if (quantities.empty()) return;
  require(quantities.size() == dof_count,
          fmt::format("attribute names of /dofs has {} entries, the field has {} dofs", quantities.size(),
                      dof_count));
  std::set<std::string> names;
  for (const Quantity& quantity : quantities) {
    require(!quantity.name.empty(), "attribute names of /dofs has an empty name");
    require(
        quantity.name.find('/') == std::string::npos && quantity.name != "." && quantity.name != "..",
        fmt::format("the quantity \"{}\" needs another name: \"/\" separates groups in HDF5", quantity.name));
    require(names.insert(quantity.name).second,
            fmt::format("attribute names of /dofs has \"{}\" twice", quantity.name));
  }
}

void Validation::mesh(const Mesh& mesh) const {
  array("/mesh/points", mesh.points, {mesh.points.size() / 3, 3});
  require(mesh.nodes_per_cell > 0 && mesh.cells.size() % mesh.nodes_per_cell == 0,
          fmt::format("/mesh/cells has {} entries, not a multiple of {} nodes", mesh.cells.size(),
                      mesh.nodes_per_cell));
  const std::int64_t points = mesh.point_count();
  for (Index i = 0; i < std::ssize(mesh.cells); ++i) {
    require(mesh.cells[i] >= 0 && mesh.cells[i] < points,
            fmt::format("/mesh/cells[{},{}] is {}: the mesh has points 0 to {}", i / mesh.nodes_per_cell,
                        i % mesh.nodes_per_cell, mesh.cells[i], points - 1));
  }
}

void Validation::outputs(std::span<const SnapshotOutput> outputs, const files::Shape& grid,
                         std::size_t times) const {
  for (const SnapshotOutput& output : outputs) {
    array("/outputs/" + output.name, output.values, joined(grid, {times}));
  }
}

files::Shape grid_of(std::span<const Axis> axes) {
  files::Shape shape;
  for (const Axis& axis : axes) shape.push_back(axis.nodes.size());
  return shape;
}

files::Shape joined(files::Shape first, const files::Shape& second) {
  first.insert(first.end(), second.begin(), second.end());
  return first;
}

std::size_t product(const files::Shape& shape) {
  std::size_t n = 1;
  for (const std::size_t extent : shape) n *= extent;
  return n;
}

std::vector<Axis> read_axes(const files::Hdf5Reader& file) {
  std::vector<Axis> axes;
  for (const std::string& name : file.texts_attribute("/", "parameters")) {
    const std::string path = "/parameters/" + name;
    Axis axis{name, file.read(path), "1", "", 1.0};
    const files::Shape shape = file.shape(path);
    Validation(file.path())
        .require(shape.size() == 1,
                 fmt::format("data set {} has {} dimensions, expected 1", path, shape.size()));
    const files::Labels labels = file.labels(path);
    if (!labels.units.empty()) axis.units = labels.units;
    axis.long_name = labels.long_name;
    if (file.has_attribute(path, "reference")) axis.reference = file.number_attribute(path, "reference");
    axes.push_back(std::move(axis));
  }
  return axes;
}

std::vector<double> read_time(const files::Hdf5Reader& file) {
  const files::Shape shape = file.shape("/time");
  Validation(file.path())
      .require(shape.size() == 1, fmt::format("data set /time has {} dimensions, expected 1", shape.size()));
  std::vector<double> time = file.read("/time");
  const double seconds = files::time_factor(file, "/time");
  for (double& t : time) t *= seconds;
  return time;
}

std::string read_time_units(const files::Hdf5Reader& file) {
  const files::Labels labels = file.labels("/time");
  // Earlier files of this program say "s", "time" whatever their time is.
  if (labels.units == "1" || (labels.units == "s" && labels.long_name == "time")) return {};
  const auto unit = files::unit_of(labels.units);
  return unit && unit->si == "s" ? "s" : labels.units;
}

Dofs read_dofs(const files::Hdf5Reader& file) {
  Dofs dofs;
  if (!file.has("/dofs/points") && !file.has("/dofs/component")) return dofs;
  const files::Shape shape = file.shape("/dofs/points");
  Validation(file.path())
      .require(shape.size() == 2 && shape[1] == 3, "data set /dofs/points must have shape (n_dof, 3)");
  dofs.points = file.read("/dofs/points");
  dofs.components = file.read_integers("/dofs/component");
  return dofs;
}

std::vector<Quantity> read_quantities(const files::Hdf5Reader& file) {
  std::vector<Quantity> quantities;
  if (!file.has("/dofs") || !file.has_attribute("/dofs", "names")) return quantities;
  for (std::string& name : file.texts_attribute("/dofs", "names")) quantities.push_back({std::move(name)});
  if (!file.has_attribute("/dofs", "units")) return quantities;
  const std::vector<std::string> units = file.texts_attribute("/dofs", "units");
  Validation(file.path())
      .require(
          units.size() == quantities.size(),
          fmt::format("attribute units of /dofs has {} entries, names {}", units.size(), quantities.size()));
  for (Index i = 0; i < std::ssize(units); ++i) quantities[i].units = units[i];
  return quantities;
}

std::optional<Mesh> read_mesh(const files::Hdf5Reader& file) {
  if (!file.has("/mesh/points") && !file.has("/mesh/cells")) return std::nullopt;
  const Validation check(file.path());
  Mesh mesh;
  const files::Shape points = file.shape("/mesh/points");
  const files::Shape cells = file.shape("/mesh/cells");
  check.require(points.size() == 2 && points[1] == 3, "data set /mesh/points must have shape (n, 3)");
  check.require(cells.size() == 2 && cells[1] > 0,
                "data set /mesh/cells must have shape (c, nodes per cell)");
  mesh.points = file.read("/mesh/points");
  mesh.cells = file.read_integers("/mesh/cells");
  mesh.nodes_per_cell = cells[1];
  mesh.type = file.text_attribute("/mesh/cells", "type");
  return mesh;
}

std::vector<SnapshotOutput> read_outputs(const files::Hdf5Reader& file, const files::Shape& grid,
                                         std::size_t times) {
  std::vector<SnapshotOutput> outputs;
  if (!file.has("/outputs")) return outputs;
  for (const std::string& name : file.members("/outputs")) {
    const std::string path = "/outputs/" + name;
    outputs.push_back({name, file.labels(path), file.read(path, joined(grid, {times}))});
  }
  return outputs;
}

void write_axes(files::Hdf5Writer& file, std::span<const Axis> axes, std::span<const double> time,
                const std::string& time_units) {
  std::vector<std::string> names;
  for (const Axis& axis : axes) {
    names.push_back(axis.name);
    const std::string path = "/parameters/" + axis.name;
    const std::string long_name = axis.long_name.empty() ? "parameter " + axis.name : axis.long_name;
    file.write(path, axis.nodes, {axis.nodes.size()}, {axis.units, long_name});
    file.number_attribute(path, "reference", axis.reference);
  }
  file.texts_attribute("/", "parameters", names);
  file.write("/time", time, {time.size()}, {time_units.empty() ? "1" : time_units, "model time"});
}

void write_dofs(files::Hdf5Writer& file, const Dofs& dofs) {
  if (dofs.empty()) return;
  const std::size_t n = dofs.components.size();
  file.write("/dofs/points", dofs.points, {n, 3}, {"m", "point of each degree of freedom"});
  file.write_integers("/dofs/component", dofs.components, {n}, {"1", "direction: 0 x, 1 y, 2 z"});
}

void write_quantities(files::Hdf5Writer& file, std::span<const Quantity> quantities) {
  if (quantities.empty()) return;
  std::vector<std::string> names, units;
  for (const Quantity& quantity : quantities) {
    names.push_back(quantity.name);
    units.push_back(quantity.units);
  }
  file.make_group("/dofs");
  file.texts_attribute("/dofs", "names", names);
  file.texts_attribute("/dofs", "units", units);
}

void write_mesh(files::Hdf5Writer& file, const std::optional<Mesh>& mesh) {
  if (!mesh) return;
  file.write("/mesh/points", mesh->points, {mesh->point_count(), 3}, {"m", "mesh points"});
  file.write_integers("/mesh/cells", mesh->cells, {mesh->cell_count(), mesh->nodes_per_cell},
                      {"1", "point indices of each cell, VTK order"});
  file.text_attribute("/mesh/cells", "type", mesh->type);
}

void write_outputs(files::Hdf5Writer& file, std::span<const SnapshotOutput> outputs, const files::Shape& grid,
                   std::size_t times) {
  for (const SnapshotOutput& output : outputs) {
    file.write("/outputs/" + output.name, output.values, joined(grid, {times}), output.labels);
  }
}

}  // namespace knothe::model
