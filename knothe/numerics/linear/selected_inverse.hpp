#pragma once
/// @file Those entries of the inverse of a sparse matrix that lie on the pattern of its Cholesky factor.
#include <Eigen/SparseCore>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// Diagonal and pattern entries of A⁻¹ for a symmetric positive definite A, by the recursion of Takahashi,
/// Fagan and Chen (1973) on A = L Lᵀ: Z_ij = δ_ij / L_jj² − (1/L_jj) Σ_{k>j} Z_ik L_kj, from the last column
/// to the first. It costs about as much as the factorisation, where a solve for every column would cost n
/// times a solve.
class SelectedInverse {
 public:
  /// Errors: NumericalError if the matrix is not positive definite. Only the lower triangle of `matrix` is
  /// read.
  explicit SelectedInverse(const Eigen::SparseMatrix<double>& matrix);

  [[nodiscard]] const Eigen::VectorXd& diagonal() const { return diagonal_; }
  /// (A⁻¹)_ij; entries of the pattern of A are always there. Errors: UsageError for one that is not.
  [[nodiscard]] double entry(Index i, Index j) const;
  /// A⁻¹ e_j, by the factor.
  [[nodiscard]] Eigen::VectorXd column(Index j) const;

 private:
  Eigen::VectorXd diagonal_;
  Eigen::SparseMatrix<double> lower_;    ///< L, in the factor's order
  Eigen::SparseMatrix<double> inverse_;  ///< lower triangle in the factor's order
  Eigen::VectorXi position_;             ///< of an index in the factor's order
};

}  // namespace knothe::numerics
