#pragma once
/// @file The instant that a forecast is for, and the model's prediction there.
#include <Eigen/Core>
#include <span>
#include <string>

#include "knothe/model/reduced/parameter_functions.hpp"

namespace knothe::assimilation {

/// y_T(p) = lift + modes w(p): the observed displacements at the horizon T, in m (Rubio et al. 2019, Eq. 12
/// at t = T, with the part that does not depend on p lifted out). modes = (O U) C_T.
struct LinearPrediction {
  Eigen::VectorXd lift;   ///< n_obs
  Eigen::MatrixXd modes;  ///< n_obs × r
};

/// A horizon between two steps of the model: weight of step `upper` is `fraction`, of `lower` 1 − fraction.
struct TimePosition {
  std::size_t lower = 0;
  std::size_t upper = 0;
  double fraction = 0.0;

  /// Linear interpolation of a quantity that is known at every step.
  template <class Quantity>
  [[nodiscard]] Quantity interpolate(const Quantity& at_lower, const Quantity& at_upper) const {
    if (lower == upper) return at_lower;
    return Quantity((1.0 - fraction) * at_lower + fraction * at_upper);
  }
};

/// Where `horizon` lies among the model's `times` (strictly increasing). A horizon within 1e-6 of a step from
/// one of them is that step exactly. Errors: ProjectError for a horizon outside [times.front(), times.back()]
/// or not finite; `option` is its name, "[forecast.crack] horizon".
[[nodiscard]] TimePosition locate_horizon(std::span<const double> times, double horizon,
                                          const std::string& option);

/// Interpolates a prediction between two steps. Shapes must agree.
[[nodiscard]] LinearPrediction interpolate(const TimePosition& position, const LinearPrediction& at_lower,
                                           const LinearPrediction& at_upper);

/// Mean and covariance of w(p) over weighted points of p.
struct FunctionMoments {
  Eigen::VectorXd mean;        ///< r
  Eigen::MatrixXd covariance;  ///< r × r, symmetric, positive semidefinite up to rounding
};

/// Moments of the rows of `functions` (n × r, e.g. FunctionBatch::value) with weights (n, non-negative, any
/// sum > 0).
[[nodiscard]] FunctionMoments moments_of_functions(const Eigen::Ref<const model::RowMatrix>& functions,
                                                   const Eigen::Ref<const Eigen::VectorXd>& weights);

}  // namespace knothe::assimilation
