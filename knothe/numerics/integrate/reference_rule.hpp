#pragma once
/// @file The rules for integrals over the reference density N(0, I), one of which is chosen by its name.
#include <cstdint>
#include <string_view>

#include "knothe/numerics/integrate/quadrature.hpp"

namespace knothe::numerics {

enum class ReferenceRuleKind {
  tensor_gauss_hermite,  ///< exact to degree 2 nodes − 1 in each variable; nodes^d points: d ≤ 4 or so
  smolyak,               ///< exact to total degree 2 level + 1; weights of both signs: see smolyak.hpp
  sobol,                 ///< scrambled Sobol points, d ≤ 200; best for 2^m points
  halton,                ///< scrambled Halton points, d ≤ 1000, any number of points
  monte_carlo            ///< independent draws
};
[[nodiscard]] std::string_view name_of(ReferenceRuleKind kind);

/// A choice of rule. Every kind reads the fields that it needs.
struct ReferenceRule {
  ReferenceRuleKind kind = ReferenceRuleKind::sobol;
  Eigen::Index points = 1024;  ///< Sobol, Halton, Monte Carlo
  std::uint64_t seed = 1;      ///< Sobol, Halton, Monte Carlo; 0 is the plain Sobol or Halton sequence
  int nodes = 10;              ///< tensor Gauss–Hermite: per variable, 1 … 128
  double drop = 0;             ///< tensor Gauss–Hermite: nodes of smaller weight are left out
  int level = 3;               ///< Smolyak, 0 … 30
  /// Sobol, Halton, Monte Carlo: mean made exactly 0 and covariance exactly the identity by a shift and a
  /// shear, if there are more points than variables; a Gaussian target then has exactly its affine map.
  bool match_moments = false;
};

/// Points (N × d) and weights (N, sum 1) with Σ w_i f(x_i) ≈ ∫ f(x) ρ(x) dx, ρ the density of N(0, I). The
/// same on every machine with the same arithmetic. Errors: UsageError for d < 1, fewer than 1 point, and
/// those of the rules; a tensor rule of more than 20,000,000 points.
[[nodiscard]] PointRule reference_rule(const ReferenceRule& rule, Eigen::Index d);

}  // namespace knothe::numerics
