#pragma once
/// @file What every method of sampling gives: points, weights, evidence where it has one, and how good it is.
#include <Eigen/Core>
#include <cstdint>

namespace knothe::sampling {

struct WeightedSample {
  Eigen::MatrixXd points;         ///< z, n × d
  Eigen::VectorXd weights;        ///< n, sum 1
  double effective_size = 0;      ///< as a number of independent draws, ≤ n
  double log_evidence = 0;        ///< log ∫ π̄, if `has_evidence`
  double log_evidence_error = 0;  ///< standard error of it
  bool has_evidence = false;
  std::int64_t density_evaluations = 0;
};

/// Moments of a weighted sample; the covariance divides by the sum of the weights. Errors: UsageError for no
/// points, sizes that disagree, weights that are negative or all zero.
[[nodiscard]] Eigen::VectorXd mean_of(const WeightedSample& sample);
[[nodiscard]] Eigen::MatrixXd covariance_of(const WeightedSample& sample);

}  // namespace knothe::sampling
