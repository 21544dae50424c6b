#pragma once
/// @file Dominant subspaces of large matrices.
#include <Eigen/Core>
#include <cstdint>

#include "knothe/base/index.hpp"

namespace knothe::model {

/// An orthonormal basis of the dominant left singular vectors of A.
struct DominantSpace {
  Eigen::MatrixXd basis;   ///< rows × l, by falling singular value
  Eigen::VectorXd energy;  ///< l, squared norm of A in the direction of each
  double total = 0.0;      ///< ‖A‖²
  double rest = 0.0;       ///< ‖A − U Uᵀ A‖²

  /// ‖A − P_l A‖².
  [[nodiscard]] double rest_from(Index l) const { return rest + energy.tail(energy.size() - l).sum(); }
  /// Smallest l with ‖A − P_l A‖² ≤ `allowed`; all columns if none.
  [[nodiscard]] Index rank_for(double allowed) const;
};

/// A matrix that is never formed: known by its products.
class LargeMatrix {
 public:
  virtual ~LargeMatrix() = default;
  [[nodiscard]] virtual Index rows() const = 0;
  [[nodiscard]] virtual Index cols() const = 0;
  [[nodiscard]] virtual Eigen::MatrixXd times(const Eigen::MatrixXd& b) const = 0;             ///< A B
  [[nodiscard]] virtual Eigen::MatrixXd transposed_times(const Eigen::MatrixXd& b) const = 0;  ///< Aᵀ B
  [[nodiscard]] virtual Eigen::MatrixXd gram() const = 0;  ///< A Aᵀ, asked for where A has few rows
  [[nodiscard]] virtual double squared_norm() const = 0;
};

/// How much of a matrix its dominant space is to hold.
struct SpaceSearch {
  double allowed = 0.0;  ///< columns enough that ‖A − U Uᵀ A‖² is at most this, or all
  Index at_least = 0;    ///< columns that are wanted in any case
  /// Iterates until the columns are the singular vectors themselves, not only a space as good as asked for.
  bool converge = false;
  std::uint64_t seed = 1;
};

/// Small problems directly, large ones by a randomised range finder with subspace iteration (Halko,
/// Martinsson, Tropp 2011, Alg. 4.4), block doubled until it is enough: some four products with a block of
/// twice the columns. The result depends on `seed` but not on `threads`.
[[nodiscard]] DominantSpace dominant_space(const LargeMatrix& a, const SpaceSearch& search);
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
[[nodiscard]] Eigen::MatrixXd normal_matrix(Index rows, Index columns, std::uint64_t seed);

}  // namespace knothe::model
