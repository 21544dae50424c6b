#pragma once
/// @file A noise level that is not known: one factor of all variances, inferred with the parameters.
#include "knothe/likelihood/step/step_form.hpp"
#include "knothe/posterior/log_density.hpp"

namespace knothe::likelihood {

/// R = s R₀ with s ~ inverse-gamma(shape a, scale b), integrated out in closed form:
///   π(d | p) = (2π)^{−N/2} Π det R₀^{−1/2} · bᵃ/Γ(a) · Γ(a + N/2) · [b + Q₀(p)/2]^{−(a + N/2)},
/// Q₀ the misfit at s = 1 and N the number of values. A Student-t distribution of all data together: it is
/// not additive over the steps, but a function of the sums that are. Where data grow old, each value's
/// density to the power λ, N is the sum of these powers.
class NoiseLevel {
 public:
  /// a > 0, b > 0; the mean of s is b/(a − 1) for a > 1. Errors: UsageError.
  NoiseLevel(double shape, double scale);
  /// The data from now on.
  void set(const StepForm& form);
  /// Changes log-likelihoods at s = 1 (all constants included), and their derivatives, to those with s
  /// integrated out.
  void marginalise(int derivatives, posterior::LogDensityBatch& out) const;
  /// E[s | p, data] from the marginalised log-likelihood at p; a + N/2 > 1.
  [[nodiscard]] double expected(double log_likelihood) const;

 private:
  double shape_, scale_;
  double exponent_ = 0;        ///< a + N/2
  double constant_ = 0;        ///< all of log π(d | p) but the last factor
  double log_normaliser_ = 0;  ///< N log 2π + Σ log det R₀
};

}  // namespace knothe::likelihood
