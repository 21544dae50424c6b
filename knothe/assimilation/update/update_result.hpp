#pragma once
/// @file What a sequential update answers after each datum.
#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/monitor/evidence_monitor.hpp"
#include "knothe/assimilation/verdict/verdict.hpp"
#include "knothe/likelihood/noise/conditional_filter.hpp"
#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/likelihood/step/posterior_functions.hpp"
#include "knothe/posterior/posterior.hpp"

namespace knothe::assimilation {

/// Wall-clock time of each phase of an update, µs.
struct UpdateTimes {
  double projection = 0;  ///< datum → quadratic form
  double map = 0;         ///< maximum, pre-map, adaptive map, verification
  double correction = 0;  ///< importance weights, moments, quantiles, evidence
  double watch = 0;       ///< monitor of the evidence, bias
  double verdict = 0;     ///< tests of the residuals, the model's own error
  [[nodiscard]] double total() const { return projection + map + correction + watch + verdict; }
};

/// An error that all data have together (`likelihood::LastingError`), as they say it is.
struct EstimatedError {
  std::string name;
  double mean = 0, std = 0;
};

/// Of `states`, whose v is w, over a posterior of w.
[[nodiscard]] inline std::vector<EstimatedError> estimated_errors(const likelihood::LastingErrors& lasting,
                                                                  const likelihood::ConditionalStates& states,
                                                                  const likelihood::PosteriorFunctions& w) {
  std::vector<EstimatedError> estimated;
  if (states.mean.size() == 0 || w.mean.size() == 0) return estimated;
  const Eigen::MatrixX2d moments = states.moments(w.mean, w.factor);
  for (const likelihood::LastingError& error : lasting.errors) {
    const auto row = error.std * moments.row(std::ssize(estimated));
    estimated.push_back({error.name, row[0], row[1]});
  }
  return estimated;
}

/// What `errors`, those of `lasting`, add to the values of step `step` by their means, n.
[[nodiscard]] inline Eigen::VectorXd expected_error(const likelihood::LastingErrors& lasting,
                                                    std::size_t step,
                                                    std::span<const EstimatedError> errors) {
  Eigen::VectorXd standardised(std::ssize(errors));
  for (Eigen::Index k = 0; k < standardised.size(); ++k)
    standardised[k] = errors[k].mean / lasting.errors[k].std;
  return lasting.factors.at(step) * standardised;
}

/// A correction of the model's bias; what does not apply is empty.
struct EstimatedBias {
  Eigen::VectorXd functions;  ///< r, to be added to the model's functions w: a field
  Eigen::VectorXd sensors;    ///< n, at the sensors, m
};

/// What an update did, and the posterior it found: importance-corrected, and where the map is not to be
/// trusted and there are at most two parameters by quadrature instead (`remark` says so).
struct UpdateResult : posterior::Posterior {
  std::size_t step = 0;
  double time = 0;  ///< model time

  double log_evidence_increment = 0;                 ///< log p(d_i | d₀ … d_{i−1})
  Eigen::Index used = 0, rejected = 0, missing = 0;  ///< values of this datum

  bool bias_corrected = false;  ///< this datum was assimilated with the corrected model
  MonitorReport monitor;        ///< how well the data before predicted this one
  /// What the monitor found or did at this step, in words: the alarm, correction switched on or off, steps
  /// that were withdrawn and assimilated again. Mostly empty.
  std::string notice;
  Verdict verdict;  ///< may it be used, and why not; made by the engine
  UpdateTimes elapsed_us;
};

}  // namespace knothe::assimilation
