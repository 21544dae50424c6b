#pragma once
/// @file Marginal densities of the posterior for plots and files.
#include <Eigen/Core>
#include <vector>

#include "knothe/posterior/prior/prior.hpp"

namespace knothe::posterior {

/// A density at increasing points.
struct MarginalDensity {
  std::vector<double> points;   ///< p
  std::vector<double> density;  ///< per unit of p, integrates to 1 over the support
};

/// Weighted Gaussian kernel density of one parameter, reflected at finite ends of the prior's support so that
/// no mass leaks out of the box; kernel width by Silverman's rule for the effective sample size. `values` and
/// `weights`: n.
[[nodiscard]] MarginalDensity marginal_density(const Eigen::Ref<const Eigen::VectorXd>& values,
                                               const Eigen::Ref<const Eigen::VectorXd>& weights,
                                               const Prior& prior, int points = 161);

/// The prior itself on the same kind of grid.
[[nodiscard]] MarginalDensity marginal_density(const Prior& prior, int points = 161);

}  // namespace knothe::posterior
