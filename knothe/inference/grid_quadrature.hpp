#pragma once
/// @file The posterior by a trapezoidal rule along the axes of its Laplace approximation: few evaluations, an
/// error estimate, no map.
#include <Eigen/Core>

#include "knothe/sampling/checked_density.hpp"

namespace knothe::inference {

struct GridQuadrature {
  Eigen::MatrixXd points;   ///< z, n × d, of those nodes that weigh something
  Eigen::VectorXd weights;  ///< n, sum 1
  double log_evidence = 0;
  int nodes = 0;  ///< per axis
  /// Change from every other node to all of them: of log-evidence, and of means and deviations in units of
  /// the posterior's standard deviation. The true error is smaller still, as the rule converges faster than
  /// any power.
  double evidence_change = 0, moment_change = 0;
  double mass_at_border = 0;  ///< share of the mass in the outermost layer of the grid
  [[nodiscard]] bool resolved() const {
    return evidence_change <= 0.01 && moment_change <= 0.01 && mass_at_border <= 1e-5;
  }
};

/// z = μ + L u with mode μ and Laplace factor L; the box of u is grown until the density is e⁻²² of its
/// maximum at every face and all modes found are inside; nodes are doubled until the answer no longer
/// changes, or there would be more than about 120,000. Errors: UsageError for d > 3; those of ModeSearch.
[[nodiscard]] GridQuadrature grid_quadrature(sampling::CheckedDensity& target);

}  // namespace knothe::inference
