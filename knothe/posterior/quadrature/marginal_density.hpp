#pragma once
/// @file Marginal densities of the posterior for plots and files.
#include <Eigen/Core>
#include <vector>

#include "knothe/posterior/prior/prior.hpp"

namespace knothe::posterior {

/// A density at increasing points.
struct MarginalDensity {
  std::vector<double> points;   ///< p
  std::vector<double> density;  ///< per unit of p, not negative, integrates to 1 over the support
};

/// Weighted kernel density of one parameter, reflected at finite ends of the prior's support so that no mass
/// leaks out of the box; kernel width by Silverman's rule for the effective sample size. The kernel is of
/// fourth order: a Gaussian one lowers a peak by half its width squared, 4 % at 700 effective points, so that
/// methods with different numbers of points would draw different curves of one posterior. `values`,
/// `weights`: n.
[[nodiscard]] MarginalDensity marginal_density(const Eigen::Ref<const Eigen::VectorXd>& values,
                                               const Eigen::Ref<const Eigen::VectorXd>& weights,
                                               const Prior& prior, int points = 161);

/// The prior itself on the same kind of grid.
[[nodiscard]] MarginalDensity marginal_density(const Prior& prior, int points = 161);

}  // namespace knothe::posterior
