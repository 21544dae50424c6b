#pragma once
/// @file Moments to fourth order of weighted points.
#include <Eigen/Core>

namespace knothe::transport {

/// Mean and covariance; skewness and kurtosis of each coordinate.
struct Moments {
  Eigen::VectorXd mean;        ///< d
  Eigen::MatrixXd covariance;  ///< d × d
  Eigen::VectorXd skewness;    ///< d, E(z − μ)³/σ³
  Eigen::VectorXd kurtosis;    ///< d, E(z − μ)⁴/σ⁴: 3 for a Gaussian
};

/// Moments of the points (n × d) under the weights (n, ≥ 0 with a positive sum; divided by it). Skewness and
/// kurtosis of a coordinate without spread are 0 and 3. Errors: UsageError for sizes that disagree, no
/// points, weights that are negative, not finite or all zero.
[[nodiscard]] Moments moments_of(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                 const Eigen::Ref<const Eigen::VectorXd>& weights);

}  // namespace knothe::transport
