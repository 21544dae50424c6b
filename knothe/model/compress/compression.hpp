#pragma once
/// @file From snapshots to a separated model (docs/explanation/reduction.md). No Eigen types here.
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"
#include "knothe/model/reduced/model_file.hpp"

namespace knothe::model {

/// In which norm over the parameters the truncation is optimal (docs/explanation/reduction.md): of the values
/// at the nodes, or of the splines through them. Errors are reported in the first one either way.
enum class ParameterNorm { nodes, spline };

struct CompressionOptions {
  Form form = Form::tree;
  std::size_t modes = 0;  ///< m (canonical) or r (tree); 0: as many as `tolerance` needs
  double tolerance = 1e-4;  ///< on ‖u − û‖ / ‖u‖ over the grid, both plain and weighted by quadrature
  std::size_t max_modes = 60;  ///< canonical form: the search by tolerance stops here
  std::uint64_t seed = 1;      ///< of the random starts
  bool grown_start = true;     ///< canonical form: a start whose modes are found one after the other is tried
  std::size_t random_starts = 3;  ///< and so many random ones; UsageError without any start
  std::size_t sweeps = 1500;      ///< canonical form: most ALS sweeps from each start
  std::size_t threads = 0;        ///< 0: all
  ParameterNorm parameter_norm = ParameterNorm::spline;  ///< tree form; the canonical one takes `nodes`
  bool quiet = true;                                     ///< no progress on stderr
};

/// A full-order solution at parameters that are no grid point.
struct OffGridSolution {
  std::vector<double> parameters;            ///< [d]
  std::vector<double> values;                ///< [n_t, n_dof]
  std::vector<SnapshotOutput> outputs = {};  ///< [n_t] each; those that are known
};

/// How far a model û is from solutions u. Norms are over all dofs, times (trapezoid weights) and solutions
/// (quadrature weights on the grid, equal weights off it).
struct ModelError {
  double relative = 0.0;          ///< ‖u − û‖ / ‖u‖
  double relative_to_lift = 0.0;  ///< ‖u − û‖ / ‖u − u_lift‖: without the part that needs no model
  double max = 0.0;               ///< largest |u − û| on any dof at any time, in the field's unit (m)
  double plain_relative = 0.0;    ///< ‖u − û‖ / ‖u‖ with equal weights
};

/// One line of a study: a model with so many modes, and its errors.
struct CompressionRow {
  std::size_t parameter_modes = 0;  ///< m or r
  std::size_t space_modes = 0;      ///< m or l
  ModelError training;
  std::optional<ModelError> off_grid;
};

/// The model of these snapshots. `relative_error` and `max_error_m` are filled, `project` is left to the
/// caller. NumericalError if the tolerance cannot be reached (canonical form).
[[nodiscard]] ModelContents compress(const Snapshots& snapshots, const CompressionOptions& options);

/// Errors at the grid points.
[[nodiscard]] ModelError training_error(const ModelContents& model, const Snapshots& snapshots,
                                        std::size_t threads = 0);
/// Errors at other points.
[[nodiscard]] ModelError off_grid_error(const ModelContents& model,
                                        std::span<const OffGridSolution> solutions);
/// Of `count` solutions that need not be in memory together.
[[nodiscard]] ModelError off_grid_error(const ModelContents& model, std::size_t count,
                                        const std::function<OffGridSolution(std::size_t)>& solution,
                                        std::size_t threads = 0);

/// A model with its line of the study.
struct StudiedModel {
  CompressionRow row;
  ModelContents model;
};

/// Models with each of these numbers of modes (increasing), and their errors; `modes` and `tolerance` of the
/// options are not used. The decomposition that all share is computed once.
[[nodiscard]] std::vector<StudiedModel> compression_study(const Snapshots& snapshots,
                                                          const CompressionOptions& options,
                                                          std::span<const std::size_t> modes,
                                                          std::span<const OffGridSolution> off_grid = {});

}  // namespace knothe::model
