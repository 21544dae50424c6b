#pragma once
/// @file Dominant subspaces of large matrices.
#include <Eigen/Core>
#include <cstdint>

namespace knothe::reduction {

/// An orthonormal basis of the dominant left singular vectors of A.
struct DominantSpace {
  Eigen::MatrixXd basis;   ///< rows × l, by falling singular value
  Eigen::VectorXd energy;  ///< l, squared norm of A in the direction of each
  double total = 0.0;      ///< ‖A‖²

  /// Smallest l with ‖A − P_l A‖² ≤ `allowed`; all columns if none.
  [[nodiscard]] Eigen::Index rank_for(double allowed) const;
};

/// Columns enough that ‖A − U Uᵀ A‖² ≤ `allowed`, or all. Small problems directly, large ones by a randomised
/// range finder with subspace iteration (Halko, Martinsson, Tropp 2011, Alg. 4.4), block doubled until it is
/// enough; the result depends on `seed` but not on `threads`.
[[nodiscard]] DominantSpace dominant_space(const Eigen::Ref<const Eigen::MatrixXd>& a, double allowed,
                                           std::uint64_t seed, std::size_t threads);

/// An orthonormal basis of the space that the columns of `a` span (Householder), rows × min(rows, columns).
[[nodiscard]] Eigen::MatrixXd orthonormal_basis(const Eigen::Ref<const Eigen::MatrixXd>& a);

/// Eigenvalues (falling, none below zero) and eigenvectors of a symmetric positive semi-definite matrix.
struct FallingEigenpairs {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
[[nodiscard]] FallingEigenpairs falling_eigenpairs(const Eigen::Ref<const Eigen::MatrixXd>& gram);

/// Random entries, standard normal, the same on every machine with the same library.
[[nodiscard]] Eigen::MatrixXd normal_matrix(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed);

}  // namespace knothe::reduction
