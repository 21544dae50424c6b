#pragma once
/// @file The quadratic form of the data, factored and cut to the rank that can be felt.
#include <Eigen/Core>

namespace knothe::likelihood {

/// vᵀHv − 2hᵀv = |Lᵀv − y|² − |y|² − 2(h − L y)·v + vᵀSv with a pivoted Cholesky factor L, r × k, of H = L Lᵀ
/// + S, and y from forward substitution in the pivots' rows: an identity but for S, the part of H that is
/// left away.
///
/// Pivots are taken until S cannot be felt: vᵀSv ≤ (Σ_k √S_kk |v_k|)² ≤ 2e-10 for every v within the bounds,
/// so that a log-likelihood is right to 1e-10; or until S is rounding. N. Higham, Accuracy and Stability of
/// Numerical Algorithms, 2002, §10.3.
class QuadraticFactor {
 public:
  /// `quadratic`: H, symmetric and positive semi-definite, r × r; `linear`: h, r; `magnitude`: bounds of
  /// |v_k|, r, any of which may be infinite. Reuses memory.
  void compute(const Eigen::MatrixXd& quadratic, const Eigen::VectorXd& linear,
               const Eigen::VectorXd& magnitude);

  [[nodiscard]] Eigen::Index rank() const { return rank_; }            ///< k
  [[nodiscard]] auto lower() const { return lower_.leftCols(rank_); }  ///< L, r × k, rows in the order of v
  [[nodiscard]] auto solution() const { return solution_.head(rank_); }  ///< y, k
  /// h − L y, r; zero in the pivots' entries, and altogether where it cannot be felt (1e-10).
  [[nodiscard]] const Eigen::VectorXd& remainder() const { return remainder_; }

 private:
  Eigen::Index rank_ = 0;
  Eigen::MatrixXd lower_;
  Eigen::VectorXd solution_, remainder_, diagonal_;
};

}  // namespace knothe::likelihood
