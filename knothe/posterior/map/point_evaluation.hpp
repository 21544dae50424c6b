#pragma once
/// @file A triangular map at one point, as it is written on paper. The fast path over blocks of points is
/// map_kernel.hpp, which is tested against this one.
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/map_structure.hpp"

namespace knothe::posterior {

class PointEvaluation {
 public:
  using Values = OneVariableBasis::Values;

  /// `structure` and `coefficients` (of the whole map) must outlive it.
  PointEvaluation(const MapStructure& structure, const double* coefficients);

  /// Variable v gets the value x.
  void set(Index v, double x);

  /// Φ_c a_c of component k, or its derivative in the variables a, b < k (−1: none; a == b: twice).
  [[nodiscard]] double constant_part(Index k, int a = -1, int b = -1) const;
  /// h(·, θ) of component k collapsed to one variable, h = Σ_j b_j χ_j(θ): b_j = Σ_{α: α_k = j} a_α Π_{i<k}
  /// χ_{α_i}(x_i), or its derivative.
  void collapse(Index k, Values& out, int a = -1, int b = -1) const;

  /// Derivatives of M^k, with x_k the value set last.
  struct Derivatives {
    double value, log_slope;
    std::vector<double> first;   ///< ∂_a M^k, a ≤ k
    std::vector<double> second;  ///< ∂_ab M^k by packed_index, if asked for
  };
  void derivatives(Index k, bool with_second, Derivatives& out);

  /// t with Φ_c a_c + ∫₀ᵗ r(Σ b_j χ_j) dθ = target for component k: an increasing function of t; a bracket is
  /// grown from 0, then Newton's method is kept inside it by bisection.
  [[nodiscard]] double solve(Index k, double target);

 private:
  /// One of the two bases with its derivatives, in every variable.
  struct Factors {
    std::vector<Values> value, first, second;
    [[nodiscard]] double at(const MultiIndex::Factor& f, int derivative) const;
    [[nodiscard]] double product(const MultiIndex& index, int below, int a, int b) const;
  };

  const MapStructure& structure_;
  const double* coefficients_;
  std::vector<double> x_;
  Factors constant_, monotone_;
  IntegrationRule rule_;
};

}  // namespace knothe::posterior
