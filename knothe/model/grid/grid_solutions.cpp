#include "knothe/model/grid/grid_solutions.hpp"

#include <algorithm>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::model {

using Eigen::MatrixXd;

namespace {

/// Values of one grid point: dofs or coordinates × n_t.
Eigen::Map<const MatrixXd> stored(const Snapshots& snapshots, std::size_t point) {
  return Eigen::Map<const MatrixXd>(snapshots.solution(point).data(), snapshots.dof_count(),
                                    std::ssize(snapshots.time));
}

std::vector<double> as_vector(const MatrixXd& matrix) {
  return {matrix.data(), matrix.data() + matrix.size()};
}

/// Largest |Q e| of any column e: columns whose norm bounds it below what is found already are not expanded.
double largest_on_dofs(const MatrixXd& basis, double longest_row, const MatrixXd& errors) {
  const Eigen::VectorXd norms = errors.colwise().norm();
  std::vector<Index> order(norms.size());
  std::iota(order.begin(), order.end(), Index{0});
  std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) { return norms[a] > norms[b]; });
  double largest = 0;
  for (const Index column : order) {
    if (!(longest_row * norms[column] > largest)) break;
    largest = std::max(largest, (basis * errors.col(column)).cwiseAbs().maxCoeff());
  }
  return largest;
}

/// Largest error on any dof over the grid of a model in coordinates.
double largest_error(const GridSolutions& solutions, const ModelContents& coordinates, std::size_t threads) {
  const double longest_row = solutions.basis.rowwise().norm().maxCoeff();
  std::vector<double> largest(solutions.snapshots.grid_size());
  parallel_for(largest.size(), threads, [&](std::size_t g) {
    const MatrixXd errors =
        stored(solutions.snapshots, g) - field_of(coordinates, functions_at_node(coordinates, g));
    largest[g] = largest_on_dofs(solutions.basis, longest_row, errors);
  });
  return *std::max_element(largest.begin(), largest.end());
}

/// A model in coordinates becomes one of fields.
void expand(const GridSolutions& solutions, ModelContents& model) {
  model.lift =
      as_vector(solutions.basis * lift_of(model));  // first: its shape is told by that of the space modes
  model.space = as_vector(solutions.basis * space_of(model));
  model.dofs = solutions.basis_dofs;
  model.mesh = solutions.basis_mesh;
}

}  // namespace

MatrixXd GridSolutions::field(std::size_t point) const {
  if (basis.size() == 0) return stored(snapshots, point);
  return basis * stored(snapshots, point);
}

Snapshots GridSolutions::at_dofs(std::span<const std::size_t> chosen) const {
  Snapshots part;
  part.axes = snapshots.axes;
  part.time = snapshots.time;
  part.time_units = snapshots.time_units;
  part.field = snapshots.field;
  const Dofs& all = dofs();
  for (const std::size_t dof : all.empty() ? std::span<const std::size_t>() : chosen) {
    part.dofs.points.insert(part.dofs.points.end(), &all.points[3 * dof], &all.points[3 * dof] + 3);
    part.dofs.components.push_back(all.components[dof]);
  }
  const std::vector<Index> rows(chosen.begin(), chosen.end());
  const MatrixXd seen = basis.size() == 0 ? MatrixXd() : MatrixXd(basis(rows, Eigen::all));
  for (std::size_t g = 0; g < snapshots.grid_size(); ++g) {
    const MatrixXd values = basis.size() == 0 ? MatrixXd(stored(snapshots, g)(rows, Eigen::all))
                                              : MatrixXd(seen * stored(snapshots, g));
    part.values.insert(part.values.end(), values.data(), values.data() + values.size());
  }
  return part;
}

GridSolutions solutions_in_modes(Snapshots frame, const MatrixXd& modes,
                                 std::span<const MatrixXd> coordinates, const MatrixXd& lift) {
  const auto times = std::ssize(frame.time);
  const auto fits = [&](const MatrixXd& c) { return c.rows() == modes.cols() && c.cols() == times; };
  if (coordinates.size() != frame.grid_size() || !fits(lift) ||
      !std::all_of(coordinates.begin(), coordinates.end(), fits))
    throw UsageError("the coordinates do not fit the modes, the time steps or the grid");
  GridSolutions result;
  result.basis = orthonormal_basis(modes);
  const MatrixXd change = result.basis.transpose() * modes;  // modes = Q change: Q spans them
  result.basis_dofs = std::move(frame.dofs);
  result.basis_mesh = std::move(frame.mesh);
  result.snapshots = std::move(frame);
  result.snapshots.dofs = {};
  result.snapshots.mesh.reset();
  result.snapshots.lift = as_vector(change * lift);
  result.snapshots.values.clear();
  result.snapshots.values.reserve(change.rows() * times * coordinates.size());
  for (const MatrixXd& c : coordinates) {
    const MatrixXd values = change * c;
    result.snapshots.values.insert(result.snapshots.values.end(), values.data(),
                                   values.data() + values.size());
  }
  return result;
}

ModelContents compress(const GridSolutions& solutions, const CompressionOptions& options) {
  ModelContents model = compress(solutions.snapshots, options);
  if (solutions.basis.size() == 0) return model;
  model.max_error_m = largest_error(solutions, model, options.threads) + solutions.largest_left_out;
  expand(solutions, model);
  return model;
}

std::vector<StudiedModel> compression_study(const GridSolutions& solutions, const CompressionOptions& options,
                                            std::span<const std::size_t> modes,
                                            std::span<const OffGridSolution> off_grid) {
  if (solutions.basis.size() == 0) return compression_study(solutions.snapshots, options, modes, off_grid);
  std::vector<StudiedModel> study = compression_study(solutions.snapshots, options, modes);
  for (StudiedModel& studied : study) {
    studied.row.training.max = largest_error(solutions, studied.model, options.threads);
    studied.model.max_error_m = studied.row.training.max;
    expand(solutions, studied.model);
    if (!off_grid.empty()) studied.row.off_grid = off_grid_error(studied.model, off_grid);
  }
  return study;
}

}  // namespace knothe::model
