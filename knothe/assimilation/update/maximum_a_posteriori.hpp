#pragma once
/// @file The most probable parameters: the maximum of the posterior density in p, inside the model's box.
#include <Eigen/Core>
#include <functional>

#include "knothe/likelihood/step/collapsed_posterior.hpp"

namespace knothe::assimilation {

/// argmax of log π(p | data) = log-likelihood(p) + log π₀(p) over the priors' supports, from `start` (d), by
/// projected Newton steps with exact derivatives (Bertsekas 1982: variables that are at a bound and pushed
/// outwards are held there). Stops at steps below `step_tolerance` times the priors' widths. The maximum of
/// the density in z is another point, by the Jacobian of p(z).
using LogLikelihood = std::function<void(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                                         posterior::LogDensityBatch& out)>;
[[nodiscard]] Eigen::VectorXd maximum_a_posteriori(const LogLikelihood& log_likelihood,
                                                   const posterior::PriorTransform& transform,
                                                   const Eigen::Ref<const Eigen::VectorXd>& start,
                                                   double step_tolerance = 1e-12);
/// The same for a collapsed posterior.
[[nodiscard]] Eigen::VectorXd maximum_a_posteriori(likelihood::CollapsedLogDensity& target,
                                                   const posterior::PriorTransform& transform,
                                                   const Eigen::Ref<const Eigen::VectorXd>& start);

}  // namespace knothe::assimilation
