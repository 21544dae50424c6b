#pragma once
/// @file The one-variable functions of a map (tailed_hermite.hpp: tangents for Φ_c, level tails for Φ_e), and
/// how rectified sums of them are integrated over [0, x].
#include <array>
#include <span>
#include <vector>

#include "knothe/posterior/map/parametrisation.hpp"

namespace knothe::posterior {

/// Σ_q weight[q] f(node[q]) for ∫₀ˣ f dθ. Weights have the sign of x.
struct IntegrationRule {
  std::vector<double> node, weight;
};

class OneVariableBasis {
 public:
  using Values = TailedHermite::Values;
  /// A stretch of |θ| on which the functions have one formula, and how many Gauss–Legendre nodes it takes.
  struct Piece {
    double end;  ///< where it ends (it begins where the one before ends, the first at 0); the last at ∞
    int nodes;
  };

  explicit OneVariableBasis(const Parametrisation& parametrisation = {});
  [[nodiscard]] const Parametrisation& parametrisation() const { return parametrisation_; }

  /// The functions 0 … n ≤ k_max_order of Φ_c at x with first and second derivatives.
  void constant(double x, int n, Values& value, Values& first, Values& second) const {
    hermite_.tangent(x, n, value, first, second);
  }
  /// Those of Φ_e.
  void monotone(double x, int n, Values& value, Values& first, Values& second) const {
    hermite_.level(x, n, value, first, second);
  }
  void monotone(double x, int n, Values& value) const { hermite_.level(x, n, value); }
  /// ∫₀ˣ of the products of two functions of Φ_e (TailedHermite).
  void product_integrals(double x, int n, std::span<double> packed) const {
    hermite_.product_integrals(x, n, packed);
  }

  /// The pieces on which r(h(θ)), h spanned by the monotone functions 0 … degree, is integrated, for θ > 0;
  /// those for θ < 0 mirror them. Exact for the square. Otherwise the numbers of nodes are measured
  /// (docs/explanation/transport.md) for a relative error of 1e-13 with coefficients of usual size, where |x|
  /// ≤ 8; far out the error may be larger, the sum stays positive.
  [[nodiscard]] std::span<const Piece> pieces(int degree) const { return pieces_[degree]; }
  /// The rule on [0, x] that those pieces make. Keeps the memory of `rule`.
  void integration_rule(double x, int degree, IntegrationRule& rule) const;

 private:
  Parametrisation parametrisation_;
  TailedHermite hermite_;
  std::array<std::vector<Piece>, k_max_order + 1> pieces_;
};

/// Nodes and weights of the Gauss–Legendre rule with `points` ≤ k_max_piece_nodes points on [0, 1], made
/// once.
struct UnitRule {
  std::vector<double> node, weight;
};
inline constexpr int k_max_piece_nodes = 64;
[[nodiscard]] const UnitRule& unit_rule(int points);

}  // namespace knothe::posterior
