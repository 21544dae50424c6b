#pragma once
/// @file Gauss rules and their tensor products.
#include <Eigen/Core>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// Nodes (increasing) and weights of a rule in one variable.
struct Quadrature {
  Eigen::VectorXd nodes;
  Eigen::VectorXd weights;
};

/// Σ w_i f(x_i) = ∫ f φ dx for polynomials up to degree 2n − 1, φ the standard normal density; 1 ≤ n ≤ 128.
/// Golub–Welsch, then Newton; weights 1/Σ ĥ_k(x_i)², which are accurate relative to themselves even where
/// tiny. Errors: UsageError.
[[nodiscard]] Quadrature gauss_hermite(int n);

/// Σ w_i f(x_i) = ∫_a^b f dx for polynomials up to degree 2n − 1. Errors: UsageError for n < 1.
[[nodiscard]] Quadrature gauss_legendre(int n, double a = -1, double b = 1);

/// Points (N × d) and weights (N) for several variables.
struct PointRule {
  Eigen::MatrixXd points;
  Eigen::VectorXd weights;
};

/// The d-fold product of a rule; the first coordinate runs fastest. Points of weight below `drop` are left
/// out and the others scaled to keep the sum of the weights.
[[nodiscard]] PointRule tensor_rule(const Quadrature& rule, Index d, double drop = 0);
/// The product of one rule per coordinate.
[[nodiscard]] PointRule tensor_rule(const std::vector<Quadrature>& rules, double drop = 0);

}  // namespace knothe::numerics
