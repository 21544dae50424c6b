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
  /// What both together state as their error: of a mean in standard deviations, of a ratio of standard
  /// deviations, of the log-evidence (four standard errors).
  double mean_limit = 0, std_limit = 0, log_evidence_limit = 0;

  /// Whether any of these is exceeded: then one of the two is wrong, trusted or not.
  [[nodiscard]] bool contradict() const;
  /// "The two agree: …" or "The two contradict each other: …", with the figures.
  [[nodiscard]] std::string in_words() const;
};

/// Errors: UsageError for results of different dimensions.
[[nodiscard]] Comparison compare(const InferenceResult& first, const InferenceResult& second);

}  // namespace knothe::assimilation
