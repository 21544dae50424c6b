#pragma once
/// @file Solutions of a full-order solver on a tensor grid of parameters, and their file (knothe model
/// import).
///
/// No Eigen types here: the offline phase, which is compiled for another instruction set, fills these.
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/files/hdf5.hpp"

namespace knothe::model {

/// One parameter: its name, the nodes of the grid in its direction, strictly increasing, and what 1.0 means.
struct Axis {
  std::string name;
  std::vector<double> nodes;
  std::string units = "1";
  std::string long_name;
  double reference = 1.0;  ///< physical value of the dimensionless 1.0, in SI units
};

/// The unit of an axis' reference value, "J/m3": the axis' own where its reference is 1, else what its long
/// name ends in, "multiple of its reference [J/m3]" or "multiple of 216 J/m3". Empty where neither says it.
[[nodiscard]] std::string reference_units(const Axis& axis);

/// Where each degree of freedom of a displacement field is, and its direction.
struct Dofs {
  std::vector<double> points;            ///< [n_dof, 3], metres
  std::vector<std::int64_t> components;  ///< [n_dof], 0 x, 1 y, 2 z
  [[nodiscard]] bool empty() const { return components.empty(); }
  /// The point of dof `i`, m.
  [[nodiscard]] std::span<const double, 3> point(std::size_t i) const {
    return std::span<const double, 3>(points.data() + 3 * i, 3);
  }
  void add(std::span<const double, 3> at, std::int64_t component) {
    points.insert(points.end(), at.begin(), at.end());
    components.push_back(component);
  }
};

/// A dof that has no place, but a name: a state, a sensor, a frequency.
struct Quantity {
  std::string name;
  std::string units = "1";
};

/// A finite-element mesh, cells in VTK's vertex order (for a hexahedron: cyclic, lower face first).
struct Mesh {
  std::vector<double> points;       ///< [n, 3], metres
  std::vector<std::int64_t> cells;  ///< [c, nodes_per_cell], indices into points
  std::size_t nodes_per_cell = 8;
  std::string type = "VTK_HEXAHEDRON";
  [[nodiscard]] std::size_t point_count() const { return points.size() / 3; }
  [[nodiscard]] std::size_t cell_count() const { return cells.size() / nodes_per_cell; }
};

/// A further scalar that the solver gives at every time, e.g. the reaction force.
struct SnapshotOutput {
  std::string name;
  files::Labels labels;
  std::vector<double> values;  ///< [n₁, …, n_d, n_t]
};

/// u on the grid. All arrays in C order: the last index is contiguous.
struct Snapshots {
  std::vector<Axis> axes;
  std::vector<double> time;    ///< [n_t], strictly increasing
  std::string time_units;      ///< empty where the solver states none
  std::vector<double> values;  ///< [n₁, …, n_d, n_t, n_dof]
  files::Labels field{"m", "displacement"};
  Dofs dofs;                         ///< empty if the field is not a displacement
  std::vector<Quantity> quantities;  ///< the dofs where they have names instead; empty: neither
  std::vector<double> lift;          ///< [n_t, n_dof], or empty: then the mean over the grid is lifted out
  std::optional<Mesh> mesh;
  std::vector<SnapshotOutput> outputs;

  [[nodiscard]] files::Shape grid_shape() const;  ///< n₁, …, n_d
  [[nodiscard]] std::size_t grid_size() const;    ///< Π nᵢ
  [[nodiscard]] std::size_t dof_count() const;    ///< n_dof
  /// The parameters at grid point `index` (C order over the axes).
  [[nodiscard]] std::vector<double> parameters_at(std::size_t index) const;
  /// The solution [n_t, n_dof] at grid point `index`.
  [[nodiscard]] std::span<const double> solution(std::size_t index) const;
};

/// Reads and validates a file of snapshots (docs/reference/formats.md). Everything wrong in it is a DataError
/// that names the data set, and the index where there is one.
[[nodiscard]] Snapshots read_snapshots(const std::string& path);
/// The same for a single solution: its axes may have one node each.
[[nodiscard]] Snapshots read_solution(const std::string& path);

/// A file of snapshots without its field.
struct SnapshotFrame {
  Snapshots snapshots;  ///< no values
  std::size_t dofs = 0;
  double factor = 1;  ///< from the field's unit to metres; 1 if it is no displacement
};

/// The first part of `read_snapshots`; the shape of the field has been checked, its numbers have not.
[[nodiscard]] SnapshotFrame read_frame(const files::Hdf5Reader& file);

/// Writes the file atomically, of a grid or of a single solution; `single_precision` stores the field in 32
/// bits. IoError, e.g. disk full.
void write_snapshots(const Snapshots& snapshots, const std::string& path, bool single_precision = false);
/// The same into a file that gets more.
void write_snapshots(const Snapshots& snapshots, files::Hdf5Writer& file, bool single_precision = false);

/// Throws DataError, prefixed by `where`, unless all shapes fit, axes have so many nodes, they and time
/// increase and all is finite.
void validate(const Snapshots& snapshots, const std::string& where, std::size_t minimum_nodes = 2);
void validate(const SnapshotFrame& frame, const std::string& where);

}  // namespace knothe::model
