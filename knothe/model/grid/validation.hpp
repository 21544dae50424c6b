#pragma once
/// @file Checks that snapshots and model files have in common. Private to this room.
#include <span>
#include <string>
#include <vector>

#include "knothe/files/hdf5.hpp"
#include "knothe/model/compress/snapshots.hpp"

namespace knothe::model {

/// Collects where a check failed; every check throws DataError "WHERE: what".
class Validation {
 public:
  explicit Validation(std::string where) : where_(std::move(where)) {}
  [[noreturn]] void fail(const std::string& what) const;
  void require(bool condition, const std::string& what) const {
    if (!condition) fail(what);
  }
  /// Data set `name` has the product of `shape` entries, all finite; a bad one is named by its full index.
  void array(const std::string& name, std::span<const double> values, const files::Shape& shape) const;
  void increasing(const std::string& name, std::span<const double> values) const;
  /// Names, nodes; at least one axis.
  void axes(std::span<const Axis> axes, std::size_t minimum_nodes = 2) const;
  void dofs(const Dofs& dofs, std::size_t dof_count) const;
  /// Names, each once, as many as dofs.
  void quantities(std::span<const Quantity> quantities, std::size_t dof_count) const;
  void mesh(const Mesh& mesh) const;
  void outputs(std::span<const SnapshotOutput> outputs, const files::Shape& grid, std::size_t times) const;

 private:
  std::string where_;
};

/// The grid of `axes`: n₁, …, n_d.
[[nodiscard]] files::Shape grid_of(std::span<const Axis> axes);

/// `first` followed by `second`.
[[nodiscard]] files::Shape joined(files::Shape first, const files::Shape& second);

[[nodiscard]] std::size_t product(const files::Shape& shape);

/// What both files hold in the same places: attribute `parameters` and /parameters, /time, /dofs, /mesh,
/// /outputs.
[[nodiscard]] std::vector<Axis> read_axes(const files::Hdf5Reader& file);
[[nodiscard]] std::vector<double> read_time(const files::Hdf5Reader& file);
/// Unit of the numbers that `read_time` gives: "s", or that of what stands for time; empty where the solver
/// stated none.
[[nodiscard]] std::string read_time_units(const files::Hdf5Reader& file);
[[nodiscard]] Dofs read_dofs(const files::Hdf5Reader& file);
/// Attributes `names` and `units` of the group /dofs.
[[nodiscard]] std::vector<Quantity> read_quantities(const files::Hdf5Reader& file);
[[nodiscard]] std::optional<Mesh> read_mesh(const files::Hdf5Reader& file);
[[nodiscard]] std::vector<SnapshotOutput> read_outputs(const files::Hdf5Reader& file,
                                                       const files::Shape& grid, std::size_t times);
void write_axes(files::Hdf5Writer& file, std::span<const Axis> axes, std::span<const double> time,
                const std::string& time_units);
void write_dofs(files::Hdf5Writer& file, const Dofs& dofs);
void write_quantities(files::Hdf5Writer& file, std::span<const Quantity> quantities);
void write_mesh(files::Hdf5Writer& file, const std::optional<Mesh>& mesh);
void write_outputs(files::Hdf5Writer& file, std::span<const SnapshotOutput> outputs, const files::Shape& grid,
                   std::size_t times);

}  // namespace knothe::model
