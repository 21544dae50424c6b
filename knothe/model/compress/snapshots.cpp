#include "knothe/model/compress/snapshots.hpp"

#include <fmt/format.h>

#include "knothe/files/atomic_file.hpp"
#include "knothe/files/units.hpp"
#include "knothe/model/grid/validation.hpp"

namespace knothe::model {

std::string reference_units(const Axis& axis) {
  if (axis.reference == 1) return axis.units;
  const std::string& text = axis.long_name;
  constexpr std::string_view k_of_its = "multiple of its reference [", k_of = "multiple of ";
  if (const auto at = text.find(k_of_its); at != std::string::npos) {
    const std::size_t begin = at + k_of_its.size();
    return text.substr(begin, text.find(']', begin) - begin);
  }
  const auto at = text.find(k_of);
  if (at == std::string::npos) return "";
  const auto space = text.find(' ', at + k_of.size());  // behind the number
  return space == std::string::npos ? "" : text.substr(space + 1);
}

files::Shape Snapshots::grid_shape() const {
  return grid_of(axes);
}

std::size_t Snapshots::grid_size() const {
  return product(grid_shape());
}

std::size_t Snapshots::dof_count() const {
  const std::size_t fields = grid_size() * time.size();
  return fields == 0 ? 0 : values.size() / fields;
}

std::vector<double> Snapshots::parameters_at(std::size_t index) const {
  std::vector<double> p(axes.size());
  for (std::size_t i = axes.size(); i-- > 0;) {
    p[i] = axes[i].nodes[index % axes[i].nodes.size()];
    index /= axes[i].nodes.size();
  }
  return p;
}

std::span<const double> Snapshots::solution(std::size_t index) const {
  const std::size_t size = time.size() * dof_count();
  return std::span(values).subspan(index * size, size);
}

namespace {

void validate_axes(const Snapshots& snapshots, const Validation& check, std::size_t minimum_nodes = 2) {
  check.axes(snapshots.axes, minimum_nodes);
  check.require(!snapshots.time.empty(), "/time is empty");
  check.increasing("/time", snapshots.time);
}

/// What stands beside axes and field.
void validate_rest(const Snapshots& snapshots, std::size_t dofs, const Validation& check) {
  check.dofs(snapshots.dofs, dofs);
  check.quantities(snapshots.quantities, dofs);
  if (!snapshots.lift.empty()) check.array("lift", snapshots.lift, {snapshots.time.size(), dofs});
  if (snapshots.mesh) check.mesh(*snapshots.mesh);
  check.outputs(snapshots.outputs, snapshots.grid_shape(), snapshots.time.size());
}

}  // namespace

void validate(const Snapshots& snapshots, const std::string& where, std::size_t minimum_nodes) {
  const Validation check(where);
  validate_axes(snapshots, check, minimum_nodes);
  const std::size_t dofs = snapshots.dof_count();
  check.require(dofs > 0, "/snapshots is empty");
  check.array("snapshots", snapshots.values, joined(snapshots.grid_shape(), {snapshots.time.size(), dofs}));
  validate_rest(snapshots, dofs, check);
}

void validate(const SnapshotFrame& frame, const std::string& where) {
  const Validation check(where);
  validate_axes(frame.snapshots, check);
  check.require(frame.dofs > 0, "/snapshots is empty");
  validate_rest(frame.snapshots, frame.dofs, check);
}

namespace {

/// The field's shape must be the grid's, then time; the message names the first axis that differs.
void check_field_shape(const files::Hdf5Reader& file, const Snapshots& snapshots) {
  const Validation check(file.path());
  const files::Shape shape = file.shape("/snapshots");
  const std::size_t d = snapshots.axes.size();
  check.require(shape.size() == d + 2,
                fmt::format("data set /snapshots has {} dimensions, expected {} ({} parameters, time, dofs)",
                            shape.size(), d + 2, d));
  for (std::size_t i = 0; i < d; ++i) {
    const Axis& axis = snapshots.axes[i];
    check.require(
        shape[i] == axis.nodes.size(),
        fmt::format("data set /snapshots has extent {} in dimension {}, but /parameters/{} has {} nodes",
                    shape[i], i, axis.name, axis.nodes.size()));
  }
  check.require(shape[d] == snapshots.time.size(),
                fmt::format("data set /snapshots has extent {} in dimension {}, but /time has {} entries",
                            shape[d], d, snapshots.time.size()));
}

void in_metres(const files::Hdf5Reader& file, const std::string& name, std::vector<double>& values) {
  const double factor = files::factor_to_si(file, name, "m");
  if (factor != 1)
    for (double& value : values) value *= factor;
}

}  // namespace

SnapshotFrame read_frame(const files::Hdf5Reader& file) {
  SnapshotFrame frame;
  Snapshots& snapshots = frame.snapshots;
  snapshots.axes = read_axes(file);
  snapshots.time = read_time(file);
  snapshots.time_units = read_time_units(file);
  check_field_shape(file, snapshots);
  frame.dofs = file.shape("/snapshots").back();
  const files::Labels labels = file.labels("/snapshots");
  if (!labels.units.empty()) snapshots.field = labels;
  snapshots.dofs = read_dofs(file);
  snapshots.quantities = read_quantities(file);
  if (!snapshots.dofs.empty()) in_metres(file, "/dofs/points", snapshots.dofs.points);
  // A displacement in millimetres; another field keeps its unit.
  if (!snapshots.dofs.empty()) {
    frame.factor = files::factor_to_si(file, "/snapshots", "m");
    snapshots.field.units = "m";
  }
  snapshots.mesh = read_mesh(file);
  if (snapshots.mesh) in_metres(file, "/mesh/points", snapshots.mesh->points);
  if (file.has("/lift")) {
    snapshots.lift = file.read("/lift", {snapshots.time.size(), frame.dofs});
    if (!snapshots.dofs.empty()) in_metres(file, "/lift", snapshots.lift);
  }
  snapshots.outputs = read_outputs(file, snapshots.grid_shape(), snapshots.time.size());
  return frame;
}

namespace {

Snapshots read_valid(const std::string& path, std::size_t minimum_nodes) {
  const files::Hdf5Reader file(path);
  SnapshotFrame frame = read_frame(file);
  frame.snapshots.values = file.read("/snapshots");
  if (frame.factor != 1)
    for (double& value : frame.snapshots.values) value *= frame.factor;
  validate(frame.snapshots, path, minimum_nodes);
  return std::move(frame.snapshots);
}

}  // namespace

Snapshots read_snapshots(const std::string& path) {
  return read_valid(path, 2);
}

Snapshots read_solution(const std::string& path) {
  return read_valid(path, 1);
}

void write_snapshots(const Snapshots& snapshots, files::Hdf5Writer& file, bool single_precision) {
  write_axes(file, snapshots.axes, snapshots.time, snapshots.time_units);
  const files::Shape shape = joined(snapshots.grid_shape(), {snapshots.time.size(), snapshots.dof_count()});
  if (single_precision) {
    file.write_single_precision("/snapshots", snapshots.values, shape, snapshots.field);
  } else {
    file.write("/snapshots", snapshots.values, shape, snapshots.field);
  }
  write_dofs(file, snapshots.dofs);
  write_quantities(file, snapshots.quantities);
  write_mesh(file, snapshots.mesh);
  if (!snapshots.lift.empty()) {
    file.write("/lift", snapshots.lift, {snapshots.time.size(), snapshots.dof_count()},
               {snapshots.field.units, "part of the field that is taken out before separation"});
  }
  write_outputs(file, snapshots.outputs, snapshots.grid_shape(), snapshots.time.size());
}

void write_snapshots(const Snapshots& snapshots, const std::string& path, bool single_precision) {
  validate(snapshots, path, 1);
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    write_snapshots(snapshots, file, single_precision);
    file.close();
  });
}

}  // namespace knothe::model
