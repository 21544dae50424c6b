#pragma once
/// @file Solutions at all points of a parameter grid, as fields or as sums of few modes (LATIN-PGD): what
/// compression takes without ever expanding the latter.
#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "knothe/model/compress/compression.hpp"
#include "knothe/model/compress/snapshots.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/truncation_error.hpp"

namespace knothe::model {

/// u(x, t, p) at the grid points. With a basis Q, u = Q c: `snapshots` then hold the coordinates c, R for
/// each step and point, as if they were dofs (and the lift's). Q is orthonormal, so norms, and with them the
/// whole decomposition, are the same for c as for u, at n_dof / R less work and memory.
struct GridSolutions {
  Snapshots snapshots;    ///< fields, or coordinates [n₁, …, n_d, n_t, R] without dofs and mesh
  Eigen::MatrixXd basis;  ///< Q, n_dof × R, orthonormal; empty: the snapshots are fields
  Dofs basis_dofs;        ///< those of Q's rows
  std::optional<Mesh> basis_mesh;
  double largest_left_out = 0;  ///< |u − Q c| on any dof

  [[nodiscard]] const Dofs& dofs() const { return basis.size() == 0 ? snapshots.dofs : basis_dofs; }
  [[nodiscard]] std::size_t dof_count() const {
    return basis.size() == 0 ? snapshots.dof_count() : static_cast<std::size_t>(basis.rows());
  }
  /// The field at a grid point, n_dof × n_t.
  [[nodiscard]] Eigen::MatrixXd field(std::size_t point) const;
  /// The solutions at these dofs alone, as snapshots without lift, mesh and outputs.
  [[nodiscard]] Snapshots at_dofs(std::span<const std::size_t> dofs) const;
};

/// The solutions (R + 1) modes `modes` (n_dof × R, of any norm) and coordinates in them, R × n_t for each
/// grid point, in an orthonormal basis. `frame` has axes, time, dofs, mesh and outputs; its lift is the sum
/// of the modes with coordinates `lift`, R × n_t. UsageError if sizes differ.
[[nodiscard]] GridSolutions solutions_in_modes(Snapshots frame, const Eigen::MatrixXd& modes,
                                               std::span<const Eigen::MatrixXd> coordinates,
                                               const Eigen::MatrixXd& lift);

/// As for snapshots; the model is that of the expanded ones to rounding.
[[nodiscard]] ModelContents compress(const GridSolutions& solutions, const CompressionOptions& options);
[[nodiscard]] std::vector<StudiedModel> compression_study(const GridSolutions& solutions,
                                                          const CompressionOptions& options,
                                                          std::span<const std::size_t> modes,
                                                          std::span<const OffGridSolution> off_grid = {});
[[nodiscard]] TruncationError truncation_error(const ModelContents& model, const GridSolutions& solutions,
                                               std::span<const OffGridSolution> off_grid = {},
                                               std::size_t modes = 20, std::size_t threads = 0);

}  // namespace knothe::model
