#pragma once
/// @file The posterior by quadrature on a tensor grid of a few parameters, only where its mass is: what an
/// update falls back on when no map represents the posterior well (several modes, a ridge bent against the
/// box).
#include <Eigen/Core>
#include <vector>

#include "knothe/reduction/grid/grid_evaluator.hpp"
#include "knothe/sampling/log_density.hpp"

namespace knothe::assimilation {

/// Nodes in z with normalised weights, and what follows from them.
struct QuadraturePosterior {
  Eigen::MatrixXd points;     ///< n × d, z
  Eigen::VectorXd weights;    ///< n, sum 1
  Eigen::MatrixXd quantiles;  ///< d × levels (`k_quantile_levels`), marginal
  double log_evidence = 0;
  /// Change of the log-evidence when every other node is left out: an error estimate (the rule converges
  /// faster than any power).
  double refinement_change = 0;
  /// All nodes that were looked at: two parameters, else empty.
  struct Nodes {
    Eigen::MatrixXd axes;                  ///< n × 2
    std::vector<reduction::GridRun> runs;  ///< of them
    Eigen::VectorXd weights;               ///< sum 1
    std::vector<Eigen::Index> kept;        ///< which of them are `points`
  } nodes;
};

/// Largest number of parameters for which this pays.
inline constexpr Eigen::Index k_most_quadrature_parameters = 2;

/// Trapezoidal rule on the smallest window that holds the mass, evaluated only near coarse nodes whose
/// density is within exp(−30) of the maximum, and refined until leaving out every other node changes the
/// log-evidence by less than 1e-3. A target that is a `reduction::GridEvaluator` is asked row by row. d ≤
/// `k_most_quadrature_parameters` (asserted).
[[nodiscard]] QuadraturePosterior tensor_quadrature(sampling::LogDensity& target);

}  // namespace knothe::assimilation
