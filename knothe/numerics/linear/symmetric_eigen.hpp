#pragma once
// Eigenvalues of a dense symmetric matrix, compiled once: Eigen's solver takes 7 s in every file that has it.
#include <Eigen/Core>

namespace knothe::numerics {

/// A = vectors diag(values) vectorsᵀ of a symmetric n × n matrix, whose lower triangle alone is read.
/// Eigen::SelfAdjointEigenSolver (implicit QR); all entries must be finite.
class SymmetricEigen {
 public:
  explicit SymmetricEigen(const Eigen::MatrixXd& matrix);
  /// n values, rising.
  [[nodiscard]] const Eigen::VectorXd& eigenvalues() const { return eigenvalues_; }
  /// n × n, a vector a column, orthonormal.
  [[nodiscard]] const Eigen::MatrixXd& eigenvectors() const { return eigenvectors_; }

 private:
  Eigen::VectorXd eigenvalues_;
  Eigen::MatrixXd eigenvectors_;
};

}  // namespace knothe::numerics
