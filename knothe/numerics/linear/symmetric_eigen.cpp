#include "knothe/numerics/linear/symmetric_eigen.hpp"

#include <Eigen/Eigenvalues>

namespace knothe::numerics {

SymmetricEigen::SymmetricEigen(const Eigen::MatrixXd& matrix) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(matrix);
  eigenvalues_ = solver.eigenvalues();
  eigenvectors_ = solver.eigenvectors();
}

}  // namespace knothe::numerics
