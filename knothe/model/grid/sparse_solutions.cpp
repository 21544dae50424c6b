#include "knothe/model/grid/sparse_solutions.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr std::array k_node_counts = {2, 3, 4, 5, 7, 9, 13, 17, 25, 33};

/// What splines through `nodes` of variable `i` miss of each polynomial at a point.
VectorXd missed_by_splines(const numerics::SparseInterpolation& interpolation, Index i,
                           const numerics::CubicSplineBasis& spline, const MatrixXd& at_nodes,
                           const VectorXd& p) {
  const VectorXd exact = interpolation.factors(i, p[i], interpolation.degree(i));
  const VectorXd splines = at_nodes * spline.cardinal_weights(p[i]);
  VectorXd missed = VectorXd::Ones(interpolation.count());
  for (Index j = 0; j < p.size(); ++j) {
    const VectorXd factor =
        j == i ? VectorXd(exact - splines) : interpolation.factors(j, p[j], interpolation.degree(j));
    for (Index n = 0; n < missed.size(); ++n) missed[n] *= factor[interpolation.indices()[n][j]];
  }
  return missed;
}

/// H_ν at all points of a grid, P × |Λ|.
MatrixXd basis_on_grid(const numerics::SparseInterpolation& interpolation, const Snapshots& grid) {
  MatrixXd result(grid.grid_size(), interpolation.count());
  for (Index g = 0; g < result.rows(); ++g) {
    const std::vector<double> p = grid.parameters_at(g);
    result.row(g) = interpolation.basis(Eigen::Map<const VectorXd>(p.data(), std::ssize(p))).transpose();
  }
  return result;
}

/// Rows of equal length, one for each solution.
template <class Values>
MatrixXd rows_of(std::span<const Snapshots> solutions, const Values& values) {
  const std::size_t size = values(solutions.front()).size();
  MatrixXd result(std::ssize(solutions), size);
  for (Index n = 0; n < std::ssize(solutions); ++n) {
    const std::vector<double>& row = values(solutions[n]);
    if (row.size() != size)
      throw DataError(fmt::format("run {} has {} values, the first one {}: all must have the same", n + 1,
                                  row.size(), size));
    result.row(n) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), size);
  }
  return result;
}

std::vector<double> in_c_order(const MatrixXd& matrix) {
  const RowMatrix rows = matrix;
  return {rows.data(), rows.data() + rows.size()};
}

void interpolate_outputs(const numerics::SparseInterpolation& interpolation, const MatrixXd& basis,
                         std::span<const Snapshots> solutions, Snapshots& frame) {
  frame.outputs = solutions.front().outputs;
  for (const Snapshots& solution : solutions)
    if (solution.outputs.size() != frame.outputs.size())
      throw DataError("the runs do not have the same outputs");
  for (Index k = 0; k < std::ssize(frame.outputs); ++k) {
    const MatrixXd values = rows_of(
        solutions, [k](const Snapshots& s) -> const std::vector<double>& { return s.outputs[k].values; });
    frame.outputs[k].values = in_c_order(basis * interpolation.surpluses(values));
  }
}

/// Fields of many dofs, as coordinates in the space of the runs.
GridSolutions interpolate_in_basis(const numerics::SparseInterpolation& interpolation, const MatrixXd& basis,
                                   Snapshots frame, std::span<const Snapshots> solutions) {
  constexpr double k_resolved = 1e-7;  // what squares resolve
  const auto times = std::ssize(frame.time);
  const auto dofs = std::ssize(solutions.front().values) / times;
  const auto field = [&](const std::vector<double>& values) {
    return Eigen::Map<const MatrixXd>(values.data(), dofs, times);
  };
  const auto runs = std::ssize(solutions);
  MatrixXd all = MatrixXd::Zero(dofs, (runs + 1) * times);
  for (Index n = 0; n < runs; ++n) all.middleCols(n * times, times) = field(solutions[n].values);
  if (!frame.lift.empty()) all.rightCols(times) = field(frame.lift);
  const MatrixXd modes = dominant_space(all, k_resolved * k_resolved * all.squaredNorm(), 1, 0).basis;
  const MatrixXd coordinates = modes.transpose() * all;
  MatrixXd values(runs, modes.cols() * times);
  for (Index n = 0; n < runs; ++n)
    values.row(n) = coordinates.middleCols(n * times, times).reshaped().transpose();
  const MatrixXd on_grid = basis * interpolation.surpluses(values);
  std::vector<MatrixXd> parts;
  for (Index g = 0; g < on_grid.rows(); ++g)
    parts.push_back(VectorXd(on_grid.row(g).transpose()).reshaped(modes.cols(), times));
  MatrixXd lift = coordinates.rightCols(times);
  if (frame.lift.empty()) lift = VectorXd(on_grid.colwise().mean().transpose()).reshaped(modes.cols(), times);
  GridSolutions result = solutions_in_modes(std::move(frame), modes, parts, lift);
  result.largest_left_out = (all - modes * coordinates).cwiseAbs().maxCoeff();
  return result;
}

}  // namespace

std::vector<double> graded_nodes(double lower, double upper, int count) {
  std::vector<double> nodes;
  for (int k = 0; k < count; ++k) {
    const double x = -std::cos(std::numbers::pi * k / (count - 1));
    nodes.push_back(0.5 * ((1 - x) * lower + (1 + x) * upper));
  }
  nodes.front() = lower;
  nodes.back() = upper;
  return nodes;
}

void choose_nodes(const numerics::SparseInterpolation& interpolation, const SplineAccuracy& accuracy,
                  std::vector<Axis>& axes) {
  for (Index axis = 0; axis < std::ssize(axes); ++axis) {
    const Index i = axis;
    const double lower = axes[axis].nodes.front(), upper = axes[axis].nodes.back();
    for (const int count : k_node_counts) {
      axes[axis].nodes = graded_nodes(lower, upper, count);
      const numerics::CubicSplineBasis spline(axes[axis].nodes);
      MatrixXd at_nodes(interpolation.degree(i) + 1, count);
      for (int n = 0; n < count; ++n)
        at_nodes.col(n) = interpolation.factors(i, axes[axis].nodes[n], interpolation.degree(i));
      const double error = accuracy.error(
          [&](const VectorXd& p) { return missed_by_splines(interpolation, i, spline, at_nodes, p); });
      if (error <= accuracy.allowed) break;
    }
  }
}

GridSolutions interpolate_on_grid(const numerics::SparseInterpolation& interpolation, Snapshots frame,
                                  std::span<const Snapshots> solutions) {
  if (std::ssize(solutions) != interpolation.count())
    throw UsageError(fmt::format("{} solutions for {} nodes of the interpolation", solutions.size(),
                                 interpolation.count()));
  const MatrixXd basis = basis_on_grid(interpolation, frame);
  interpolate_outputs(interpolation, basis, solutions, frame);
  const std::size_t dofs = solutions.front().dof_count();
  // Coordinates pay where there are many more dofs than the runs have directions.
  if (frame.quantities.empty() && dofs > 300)
    return interpolate_in_basis(interpolation, basis, std::move(frame), solutions);
  const MatrixXd values =
      rows_of(solutions, [](const Snapshots& s) -> const std::vector<double>& { return s.values; });
  frame.values = in_c_order(basis * interpolation.surpluses(values));
  return {.snapshots = std::move(frame)};
}

}  // namespace knothe::model
