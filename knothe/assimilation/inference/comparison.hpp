#pragma once
/// @file Two answers to the same question beside each other, in units of the posterior's standard deviation.
#include "knothe/assimilation/inference/inference.hpp"

namespace knothe::assimilation {

/// Second minus first.
struct Comparison {
  Eigen::VectorXd mean_difference;      ///< d, in units of the root mean square of both deviations
  Eigen::VectorXd std_ratio;            ///< d, second by first
  Eigen::MatrixXd quantile_difference;  ///< d × levels, in the same units
  double log_evidence_difference = 0;
  double log_evidence_error = 0;  ///< standard error of that difference
};

/// Errors: UsageError for results of different dimensions.
[[nodiscard]] Comparison compare(const InferenceResult& first, const InferenceResult& second);

}  // namespace knothe::assimilation
