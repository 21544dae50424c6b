#pragma once
/// @file Dense factorisations (LAPACK), column-major, for the condensed problem.
#include <span>
#include <vector>

namespace knothe::offline {

/// Solves A x = b in place by LU with pivoting; `matrix` (n × n) is overwritten. False if it is singular or
/// the solution is not finite.
[[nodiscard]] bool solve_dense(std::span<double> matrix, std::span<double> right_hand_side);

/// Replaces a symmetric positive definite matrix by its inverse (both triangles). False if it is not positive
/// definite.
[[nodiscard]] bool invert_positive_definite(std::span<double> matrix, int n);

/// out = A x for a symmetric matrix of which both triangles are there.
void multiply_symmetric(std::span<const double> matrix, std::span<const double> x, std::span<double> out);

/// Solves A X = B in place for a symmetric positive definite matrix, which is overwritten; B is n × columns.
[[nodiscard]] bool solve_positive_definite(std::span<double> matrix, int n,
                                           std::span<double> right_hand_sides, int columns);

}  // namespace knothe::offline
