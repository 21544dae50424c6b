#pragma once
/// @file What `tensor_quadrature` and `filled_quadrature` have in common: the target on the nodes of a
/// lattice, and the marginals of the trapezoidal rule there.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "knothe/numerics/integrate/grid_evaluator.hpp"
#include "knothe/posterior/checked_density.hpp"
#include "knothe/posterior/log_density.hpp"

namespace knothe::posterior {

/// Log-density below the maximum at which nodes count as empty: 2e-9 of a Gaussian's mass is beyond.
inline constexpr double k_mask_depth = 20;
/// That of nodes that count is above it. Of a log-density so far from zero that rounding hides the depth the
/// maximum itself still is: data that are wrong by 10⁸ of their standard deviations.
[[nodiscard]] inline double mask_floor(double maximum) {
  return std::min(maximum - k_mask_depth, std::nextafter(maximum, -std::numeric_limits<double>::infinity()));
}
inline constexpr double k_min_spread = 1e-11;   ///< of a mode, z: below it rounding leaves no room for nodes
inline constexpr double k_lattice_range = 8.5;  ///< of z; beyond it is less than 1e-16 of the prior

/// Number of nodes of the runs.
[[nodiscard]] inline Eigen::Index size_of(const std::vector<numerics::GridRun>& runs) {
  return runs.empty() ? 0 : runs.back().at + runs.back().end - runs.back().begin;
}

/// Log-density at the points (n × d), block by block: into `values`.
void evaluate_in_blocks(CheckedDensity& target, const Eigen::MatrixXd& points, LogDensityBatch& workspace,
                        Eigen::VectorXd& values);

/// Weights of nodes gathered at the lines of each axis (nodes × d), and their sum.
struct Marginals {
  Eigen::MatrixXd mass;
  double sum = 0;

  Marginals(Eigen::Index nodes, Eigen::Index dimension) : mass(Eigen::MatrixXd::Zero(nodes, dimension)) {}
  /// Every `stride`-th node of a run (weights of all nodes) from node `first` on; `row`: its nodes of the
  /// other axes.
  void add(const numerics::GridRun& run, const Eigen::VectorXd& weights, Eigen::Index first,
           Eigen::Index stride, std::span<const Eigen::Index> row);
  /// Mean and standard deviation along axis k, in spacings.
  [[nodiscard]] std::array<double, 2> moments(Eigen::Index k) const;
  /// The larger change, from `coarser` to these, of mean and standard deviation along axis k, in standard
  /// deviations.
  [[nodiscard]] double change_from(const Marginals& coarser, Eigen::Index k) const;
};

/// Weighted nodes along one axis, of one lattice or of several: a marginal.
struct LineNodes {
  std::vector<double> nodes, weights, widths;

  /// Nodes that lie `spacing` apart on average, their weights times `factor`.
  void add(std::span<const double> at, std::span<const double> weight, double spacing, double factor = 1);
  /// At `numerics::k_quantile_levels`.
  [[nodiscard]] Eigen::RowVectorXd quantiles() const;
};

}  // namespace knothe::posterior
