#pragma once
// Singular value decomposition of a dense matrix, compiled once: Eigen's takes half a minute in every file
// that has it.
#include <Eigen/Core>

namespace knothe::numerics {

/// A = left diag(values) rightᵀ with A n × m and k = min(n, m).
struct DenseSvd {
  Eigen::VectorXd values;  ///< k singular values, falling
  Eigen::MatrixXd left;    ///< n × k, orthonormal columns
  Eigen::MatrixXd right;   ///< m × k, orthonormal columns
};

/// By divide and conquer (Eigen::BDCSVD). All entries must be finite.
[[nodiscard]] DenseSvd dense_svd(const Eigen::MatrixXd& matrix);

/// The singular values alone, falling.
[[nodiscard]] Eigen::VectorXd singular_values(const Eigen::MatrixXd& matrix);

}  // namespace knothe::numerics
