#pragma once
/// @file Upper tails of the χ² distribution, central and not.
#include <span>

namespace knothe::numerics {

/// Q(a, x) = Γ(a, x)/Γ(a), the regularised upper incomplete gamma function; a > 0, x ≥ 0. Relative error
/// below 1e-12 up to a = 1e5.
[[nodiscard]] double upper_gamma(double a, double x);

/// P(X > x) for X of χ² distribution with `degrees` degrees of freedom.
[[nodiscard]] inline double chi_squared_upper(double x, double degrees) {
  return upper_gamma(0.5 * degrees, 0.5 * x);
}

/// Σ_k w_k P(X_k > x), X_k of noncentral χ² distribution with `degrees` degrees of freedom and
/// noncentrality λ_k ≥ 0: Σ_j Poisson(j; λ_k/2) Q(degrees/2 + j, x/2), the Q by their recurrence once for
/// all. Weights ≥ 0 with sum 1, as many as noncentralities.
[[nodiscard]] double mean_noncentral_upper(double x, double degrees, std::span<const double> noncentralities,
                                           std::span<const double> weights);

}  // namespace knothe::numerics
