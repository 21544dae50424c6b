#pragma once
/// @file Full-order solutions at the nodes of a sparse interpolation as those of a whole grid
/// (docs/explanation/adaptive-runs.md).
#include <functional>
#include <span>
#include <vector>

#include "knothe/model/grid/grid_solutions.hpp"
#include "knothe/numerics/functions/sparse_interpolation.hpp"

namespace knothe::model {

/// `count` nodes on [lower, upper], closer at both ends (Chebyshev–Lobatto): the splines through few of them
/// follow polynomials best.
[[nodiscard]] std::vector<double> graded_nodes(double lower, double upper, int count);

/// How many nodes of an axis splines need.
struct SplineAccuracy {
  /// How much it matters if, in the surplus form Σ_ν s_ν g_ν(p), g stands for what is missed.
  std::function<double(const std::function<Eigen::VectorXd(const Eigen::VectorXd& p)>& missed)> error;
  double allowed = 0;  ///< for each axis
};
/// Sets the nodes of `axes`: at each axis the fewest of 2, 3, 4, 5, 7, 9, 13, … 33 with which the splines
/// follow the interpolation's polynomials as allowed.
void choose_nodes(const numerics::SparseInterpolation& interpolation, const SplineAccuracy& accuracy,
                  std::vector<Axis>& axes);

/// The interpolation at all points of the grid of `frame`'s axes. `solutions`: values and outputs at its
/// nodes, in the order of its indices, all of one shape (DataError). `frame` has axes, time, dofs or
/// quantities, mesh, and the lift if there is one. Fields of many dofs are kept in a basis.
[[nodiscard]] GridSolutions interpolate_on_grid(const numerics::SparseInterpolation& interpolation,
                                                Snapshots frame, std::span<const Snapshots> solutions);

}  // namespace knothe::model
