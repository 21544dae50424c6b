#pragma once
/// @file Canonical (CP) decomposition of a small dense tensor by alternating least squares.
///
/// Source: T. G. Kolda, B. W. Bader, Tensor Decompositions and Applications, SIAM Review 51 (2009), sec. 3.4.
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::model {

/// A tensor [n₀, n₁, …, n_D]: n₀ × (n₁ … n_D), the columns in C order of the other indices.
struct CoreTensor {
  Eigen::MatrixXd unfolded;
  std::vector<Index> others;  ///< n₁, …, n_D
};

/// Σ_c ⊗_k factors[k].col(c).
struct CpFactors {
  std::vector<Eigen::MatrixXd> factors;  ///< n_k × m each
  double error = 0.0;                    ///< Frobenius norm of the difference to the tensor
  std::size_t sweeps = 0;                ///< done
  [[nodiscard]] Index modes() const { return factors.front().cols(); }
};

/// Sweeps from `start` until the error falls by less than the fraction 1e-5 in a sweep (5 times in a row), or
/// is rounding.
[[nodiscard]] CpFactors als(const CoreTensor& tensor, CpFactors start, std::size_t max_sweeps);

/// `start` (may have no modes) and one mode more: the best rank-1 tensor that alternating finds for the rest,
/// from a start drawn by `seed`.
[[nodiscard]] CpFactors with_one_more_mode(const CoreTensor& tensor, const CpFactors& start,
                                           std::uint64_t seed);

/// Random factors.
[[nodiscard]] CpFactors random_start(const CoreTensor& tensor, Index modes, std::uint64_t seed);

/// The tensor of the factors, unfolded as in CoreTensor.
[[nodiscard]] Eigen::MatrixXd unfolded(const CpFactors& cp);

}  // namespace knothe::model
