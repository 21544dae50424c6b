#pragma once
/// @file The one-variable bases of the maps: Hermite polynomials inside, tame in the tails.
///
/// ĥ_j are the probabilists' Hermite polynomials, orthonormal under N(0, 1). Plain, they grow so fast that a
/// map made where the mass is folds and overflows where it is not. Two continuations, both C¹:
///  - tangent, for Φ_c: ψ_j = ĥ_j for |x| ≤ r_c, its tangent at ±r_c beyond;
///  - level, for Φ_e: χ_j(x) = ĥ_j(τ(x)), τ(x) = x for |x| ≤ r_e, bent to ±(r_e + δ) by a parabola over a
///  length 2δ, constant beyond.
/// With level Φ_e the slope h² of a map is constant far out and the map a straight line in x_k. That is what
/// posteriors with Gaussian tails want, and it is measured (docs/explanation/transport.md): where h is free
/// to bend down in the tails, the minimiser runs into the barrier h = 0 there, and a narrow curved ridge
/// stalls at a variance diagnostic of 1e-2 … 1e-1; with level tails it goes on to 1e-3.
#include <Eigen/Core>
#include <array>
#include <span>

namespace knothe::posterior {

/// Highest order of a map.
inline constexpr int k_max_order = 23;

/// Where the tails of both bases begin.
struct TailRadii {
  double level = 2.5;    ///< r_e
  double bend = 0.5;     ///< δ
  double tangent = 3.5;  ///< r_c
  friend bool operator==(const TailRadii&, const TailRadii&) = default;
};

/// τ of Φ_e and its derivatives: x, bent to a constant.
struct BentCoordinate {
  double value, first, second;
  BentCoordinate(double x, const TailRadii& radii);
};

class TailedHermite {
 public:
  using Values = std::array<double, k_max_order + 1>;

  explicit TailedHermite(TailRadii radii = {}) : radii_(radii) {}
  [[nodiscard]] const TailRadii& radii() const { return radii_; }

  /// ψ_0(x) … ψ_n(x), n ≤ k_max_order, with first and second derivatives.
  void tangent(double x, int n, Values& value, Values& first, Values& second) const;
  /// χ_0(x) … χ_n(x), with first and second derivatives if they are wanted.
  void level(double x, int n, Values& value, Values& first, Values& second) const;
  void level(double x, int n, Values& value) const;
  /// ∫₀ˣ χ_i χ_j dθ for 0 ≤ j ≤ i ≤ n, at `packed_index(i, j)`; exact, see SquareRule.
  void product_integrals(double x, int n, std::span<double> packed) const;

 private:
  TailRadii radii_;
};

/// A rule on [0, x] that is exact for products of two functions spanned by χ_0 … χ_n: Σ_q weight[q]
/// f(argument[q]) g(argument[q]), with the functions as polynomials of τ. Gauss–Legendre on the inner part
/// and on the bend (there products have twice the degree), one term for the level part.
struct SquareRule {
  int count = 0;
  std::array<double, 3 * k_max_order + 3> argument, weight;

  SquareRule(double x, int n, const TailRadii& radii);
};

}  // namespace knothe::posterior
