#include "knothe/assimilation/inference/comparison.hpp"

#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {

Comparison compare(const InferenceResult& first, const InferenceResult& second) {
  if (first.mean.size() != second.mean.size())
    throw UsageError("comparison: the two results have different numbers of parameters");
  const Eigen::ArrayXd a = first.standard_deviations(), b = second.standard_deviations();
  const Eigen::ArrayXd unit = (0.5 * (a.square() + b.square())).sqrt().cwiseMax(1e-300);
  Comparison c;
  c.mean_difference = (second.mean - first.mean).array() / unit;
  c.std_ratio = b / a.cwiseMax(1e-300);
  c.quantile_difference = (second.quantiles - first.quantiles).array().colwise() / unit;
  c.log_evidence_difference = second.log_evidence - first.log_evidence;
  c.log_evidence_error = std::hypot(first.log_evidence_error, second.log_evidence_error);
  return c;
}

}  // namespace knothe::assimilation
