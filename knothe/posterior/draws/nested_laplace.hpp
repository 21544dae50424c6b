#pragma once
/// @file Few variables first: posteriors of many variables that are nearly Gaussian once a few are known.
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior {

struct NestedLaplaceOptions {
  std::uint64_t seed = 1;
  /// From the density's own variables to those whose means and standard deviations count (n × d); empty: the
  /// same.
  std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)> variables = {};
  std::function<bool(double)> progress = {};  ///< with the share of the work done; false interrupts
};

struct NestedLaplaceResult : ImportanceResult {
  std::vector<Eigen::Index> first;  ///< the variables drawn first
};

/// Importance sampling for hierarchical models. The variables along which the curvature at the mode changes
/// most (θ, at most four) are drawn first, from their marginal density by Laplace's method (Tierney, Kadane
/// 1986; Rue, Martino, Chopin 2009, Eq. 3),
///   log π̃(θ) = log π̄(θ, x*) + ½ log det(2π H⁻¹),  x* = argmax_x log π̄(θ, x),  H = −∂²/∂x² there,
/// by `recycled_importance`; then the others (x) from N(x*, H⁻¹). The weights are exact. One mode is assumed:
/// where there is a second one that counts, the result is not converged. Derivatives that the target lacks
/// are differences. A function of the target and the options alone. Errors: UsageError for fewer than two
/// variables; NumericalError where the density is zero at all draws; Interrupted; those of `ModeSearch` and
/// of the target.
[[nodiscard]] NestedLaplaceResult nested_laplace(LogDensity& target,
                                                 const NestedLaplaceOptions& options = {});

}  // namespace knothe::posterior
