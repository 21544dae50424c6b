#include "knothe/assimilation/inference/comparison.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

/// Of log-evidences that have no error to state.
constexpr double k_rounding = 0.02;

}  // namespace

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
  c.mean_limit = std::hypot(first.mean_error, second.mean_error);
  c.std_limit = std::hypot(first.deviation_error, second.deviation_error);
  c.log_evidence_limit = 4 * c.log_evidence_error + k_rounding;
  return c;
}

bool Comparison::contradict() const {
  return !((mean_difference.array().abs() <= mean_limit).all() &&
           (std_ratio.array().log().abs() <= std_limit).all() &&
           std::abs(log_evidence_difference) <= log_evidence_limit);
}

std::string Comparison::in_words() const {
  const std::string figures = fmt::format(
      "means differ by at most {:.3f} std (stated: {:.3f}), standard deviations by {:.1f} % (stated: {:.1f} "
      "%), "
      "log-evidences by {:.3f} (stated: {:.3f})",
      mean_difference.cwiseAbs().maxCoeff(), mean_limit, 100 * (std_ratio.array() - 1).abs().maxCoeff(),
      100 * std_limit, std::abs(log_evidence_difference), log_evidence_limit);
  if (!contradict()) return fmt::format("The two agree: {}.", figures);
  return fmt::format(
      "The two contradict each other, so that one of them is wrong: {}. A third method may tell.", figures);
}

}  // namespace knothe::assimilation
