#pragma once
/// @file The singular value decomposition of a matrix that grows by a column at a time.
#include <Eigen/Core>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// Leading singular triplets of A = [a_1 … a_i], A ≈ U diag(s) Vᵀ, brought up to date when a column arrives:
/// the sequential Karhunen-Loève algorithm of A. Levy, M. Lindenbaum, IEEE Trans. Image Process. 9 (2000).
/// The new column is split by Gram-Schmidt (twice) into its part in the span of U and a new direction q (the
/// QR decomposition of [U diag(s), a]), and the small matrix [diag(s) Uᵀa; 0 ρ] is decomposed again. A column
/// costs O(n k + n k² + W k²), whatever the number of columns before: of V only the rows of the last W
/// columns are kept.
///
/// What truncations discard is known exactly: A Aᵀ = U diag(s²) Uᵀ + D with D positive semi-definite, so that
/// 0 ≤ σ_k(A)² − s_k² ≤ trace(D) = |A|² − |s|².
class IncrementalSvd {
 public:
  /// Columns of `rows` numbers, at most `rank` triplets, rows of V for the last `window` columns. All ≥ 1.
  IncrementalSvd(Index rows, Index rank, Index window);

  /// Appends a column (finite numbers).
  void append(const Eigen::Ref<const Eigen::VectorXd>& column);

  [[nodiscard]] Index columns() const { return columns_; }                   ///< appended so far
  [[nodiscard]] Index rank() const { return rank_; }                         ///< triplets there are
  [[nodiscard]] auto space() const { return space_.leftCols(rank_); }        ///< U, rows × rank, orthonormal
  [[nodiscard]] auto singular_values() const { return value_.head(rank_); }  ///< s, decreasing
  /// The rows of V of the last min(columns, window) columns, oldest first.
  [[nodiscard]] auto time() const { return time_.topLeftCorner(kept_, rank_); }

 private:
  Index most_, window_, columns_ = 0, rank_ = 0, kept_ = 0;
  Eigen::MatrixXd space_;  ///< rows × (most + 1)
  Eigen::VectorXd value_;  ///< most + 1
  Eigen::MatrixXd time_;   ///< (window + 1) × (most + 1)
};

}  // namespace knothe::numerics
