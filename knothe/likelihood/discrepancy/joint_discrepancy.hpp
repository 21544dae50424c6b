#pragma once
/// @file Discrepancy of the model, unknown together with the parameters and integrated out.
#include <Eigen/Core>

#include "knothe/likelihood/noise/conditional_filter.hpp"
#include "knothe/likelihood/step/step_form.hpp"

namespace knothe::likelihood {

/// A bias that looks like what the model can do, only not at one fixed w: the datum at t_i is predicted by
/// w(p) + κ F ξ_i in place of w(p), with F Fᵀ the prior covariance of w and ξ_i an autoregression,
///   ξ_i = ρ ξ_{i−1} + √(1 − ρ²) η_i,   ξ_0 and η_i independent, N(0, I),   ρ = e^(−1/memory).
/// Given v = w − w₀ everything is Gaussian, so ξ_i is integrated out exactly, step by step (a Kalman filter
/// whose mean is affine in v), and the form of a datum given those before it is again a quadratic form in v,
/// made from that of the datum alone: the cost depends neither on the number of observations nor on that of
/// the steps.
///
/// Where Rubio et al. 2019, §4, extrapolate the residual of the last posterior (Eq. 16-18), this keeps its
/// dependence on the parameters: B(x, t, p) is extrapolated as a function of p. A residual at fixed p
/// confirms the estimate it was made with; see docs/explanation/assimilation.md for measured coverage.
class JointDiscrepancy {
 public:
  /// `factor`: F, r × q; `size`: κ > 0; `memory` > 0, steps.
  JointDiscrepancy(const Eigen::MatrixXd& factor, double size, double memory);

  /// No data.
  void restart();
  /// The form of the next datum given those before it; takes the datum in.
  [[nodiscard]] StepForm condition(const StepForm& form);
  /// The same where the steps share an error: what that error is, is identified from the data before, which
  /// had discrepancies u_i = κ C_i F ξ_i too; their sums per group are further states. `core`: C_i, s × r.
  [[nodiscard]] StepForm condition(const MovedForm& moved, const Eigen::MatrixXd& core);
  /// κ F E[ξ_i | v, data up to the last], r: what is to be added to w, where w = w₀ + v.
  [[nodiscard]] Eigen::VectorXd expected(const Eigen::VectorXd& v) const {
    return factor_ * filter_.expected(v).head(factor_.cols());
  }

 private:
  Eigen::MatrixXd factor_;  ///< κ F
  double rho_;
  ConditionalFilter filter_;  ///< of ξ, and (ξ, z_1 …) where steps share an error
};

}  // namespace knothe::likelihood
