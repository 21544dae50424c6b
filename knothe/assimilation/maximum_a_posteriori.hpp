#pragma once
/// @file The most probable parameters: the maximum of the posterior density in p, inside the model's box.
#include <Eigen/Core>

#include "knothe/assimilation/collapsed_posterior.hpp"

namespace knothe::assimilation {

/// argmax of log π(p | data) = log-likelihood(p) + log π₀(p) over the priors' supports, from `start` (d), by
/// projected Newton steps with exact derivatives (Bertsekas 1982: variables that are at a bound and pushed
/// outwards are held there). The maximum of the density in z is another point, by the Jacobian of p(z).
[[nodiscard]] Eigen::VectorXd maximum_a_posteriori(CollapsedLogDensity& target,
                                                   const PriorTransform& transform,
                                                   const Eigen::Ref<const Eigen::VectorXd>& start);

}  // namespace knothe::assimilation
