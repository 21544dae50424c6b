#pragma once
/// @file The one-variable basis of the maps: Hermite polynomials that go on as straight lines in the tails.
#include <Eigen/Core>
#include <array>
#include <span>

namespace knothe::transport {

/// Highest order of a map.
inline constexpr int k_max_order = 15;

/// ψ_j(x) = ĥ_j(x) for |x| ≤ r, with ĥ_j the probabilists' Hermite polynomials orthonormal under N(0, 1), and
/// the tangent at ±r outside (C¹). Plain polynomials grow so fast that a map made where the mass is folds and
/// overflows where it is not.
class TailedHermite {
 public:
  using Values = std::array<double, k_max_order + 1>;

  explicit TailedHermite(double radius = 4.0);
  [[nodiscard]] double radius() const { return radius_; }

  /// ψ_0(x) … ψ_n(x), n ≤ k_max_order.
  void evaluate(double x, int n, Values& value) const;
  /// With first and second derivatives.
  void evaluate(double x, int n, Values& value, Values& first, Values& second) const;
  /// ∫₀ˣ ψ_i ψ_j dθ for 0 ≤ j ≤ i ≤ n, at `packed_index(i, j)`; exact: Gauss–Legendre with n + 1 points up to
  /// the kink, the product of two straight lines in closed form beyond.
  void product_integrals(double x, int n, std::span<double> packed) const;

 private:
  double radius_;
};

/// A rule on [0, x] that is exact for the square of functions spanned by ψ_0 … ψ_n: nodes up to the kink,
/// then the tail. Σ_q weight[q] f(node[q]) g(node[q]) + tail(f, g); the tail is used if length ≠ 0.
struct SquareRule {
  int count = 0;
  std::array<double, k_max_order + 1> node, weight;
  double kink = 0;    ///< ±r
  double length = 0;  ///< x − kink (signed), 0 inside

  SquareRule(double x, int n, double radius);
  /// ∫ over the tail of (f0 + f1 u)(g0 + g1 u), u from 0 to `length`.
  [[nodiscard]] double tail(double f0, double f1, double g0, double g1) const {
    return length * (f0 * g0 + length * (0.5 * (f0 * g1 + f1 * g0) + length * f1 * g1 / 3));
  }
};

}  // namespace knothe::transport
