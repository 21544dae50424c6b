#pragma once
/// @file The error of a model between the nodes of its grid, from what its splines miss where nodes are left
/// out (docs/explanation/reduction.md, "Between the nodes").
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "knothe/model/grid/grid_solutions.hpp"

namespace knothe::model {

/// What the splines of one axis miss, as matrices on the values at its n nodes.
class AxisMisses {
 public:
  explicit AxisMisses(std::span<const double> nodes);
  /// Of the spline through the others at each interior node, (n − 2) × n; no rows for n = 2.
  [[nodiscard]] const Eigen::MatrixXd& left_out() const { return left_out_; }
  /// The same of the straight line through both neighbours; for n = 3 half the difference of the ends.
  [[nodiscard]] const Eigen::MatrixXd& of_lines() const { return of_lines_; }
  /// Error of the spline through all nodes, root mean square over the axis, relative to that of `left_out`,
  /// for a function whose misses have the ratio `left_out` / `of_lines`: that of the wave that has it.
  [[nodiscard]] double between_nodes(double ratio) const;

 private:
  Eigen::MatrixXd left_out_, of_lines_;
  std::vector<double> ratio_, share_;  ///< of waves, by increasing ratio
};

/// Estimated errors of a model between its nodes.
class LeftOutNodes {
 public:
  explicit LeftOutNodes(const ModelContents& model);
  /// Whether any axis has an interior node; otherwise nothing is known.
  [[nodiscard]] bool known() const;
  /// The solution at a grid point drawn by `seed`, off by what the splines are estimated to miss between the
  /// nodes around it: an error of the model to stand for that off the grid.
  [[nodiscard]] OffGridSolution solution(const GridSolutions& solutions, std::uint64_t seed) const;

 private:
  /// Estimated error of w, r, near grid point `index`, each axis at an interior node that `seed` draws.
  [[nodiscard]] Eigen::VectorXd functions_error(std::size_t index, std::uint64_t seed) const;

  const ModelContents& model_;
  std::vector<AxisMisses> axes_;
  std::vector<std::size_t> strides_;
  Eigen::MatrixXd shares_;  ///< r × d, by which what is missed at left-out nodes is multiplied
};

}  // namespace knothe::model
