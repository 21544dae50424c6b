#include "knothe/inference/verdict.hpp"

#include <fmt/format.h>

#include <vector>

namespace knothe::inference {

std::string verdict(const transport::MapResult& map, const transport::ImportanceCorrection& answer,
                    const assimilation::PriorTransform& transform) {
  if (answer.trusted)
    return fmt::format(
        "Trusted: on points not used to make it the map of order {} has a variance diagnostic of {:.2g} (at "
        "most "
        "0.05), its weights an effective sample size of {:.1f} % (at least 90 %), and no second mode was "
        "found{}{}.",
        map.order, map.verified_diagnostic, 100 * answer.ess,
        map.missed.tempered_done || map.missed.scanned
            ? ""
            : " by ascents from several starts (mode_search = \"tempered\" looks further)",
        map.tolerance_reached ? "" : fmt::format("; the tolerance was missed, though: {}", map.reason));
  std::vector<std::string> reasons;
  if (map.second_mode_found) {
    std::vector<double> p;
    for (Eigen::Index k = 0; k < map.second_mode.size(); ++k)
      p.push_back(transform.prior(k).from_standard_normal(map.second_mode[k]).value);
    reasons.push_back(p.empty()
                          ? "there is mass that the map does not cover"
                          : fmt::format("there is a second mode near ({:.4g}), which the map does not cover",
                                        fmt::join(p, ", ")));
  }
  if (map.verified_diagnostic > 0.05) {
    reasons.push_back(map.reason.empty() ? fmt::format("the variance diagnostic is {:.2g}, above 0.05",
                                                       map.verified_diagnostic)
                                         : map.reason);
  }
  if (answer.ess < 0.9)
    reasons.push_back(
        fmt::format("the effective sample size of its weights is {:.1f} %, below 90 %", 100 * answer.ess));
  if (reasons.empty())
    reasons.push_back(map.reason.empty() ? "the solver's checks did not pass" : map.reason);
  return fmt::format("Not trusted: {}; cross-check by method smc or mcmc.", fmt::join(reasons, ", and "));
}

std::string verdict(const assimilation::QuadraturePosterior& grid) {
  if (grid.resolved())
    return fmt::format(
        "Trusted: from every other to all of the {} nodes per axis the log-evidence changes by {:.1g} and "
        "moments by "
        "{:.1g} std, and {:.1g} of the mass lies at the border of the grid.",
        grid.per_axis, grid.evidence_change, grid.moment_change, grid.mass_at_border);
  return fmt::format(
      "Not trusted: the grid of {} nodes per axis does not resolve the posterior: from every other node to "
      "all of "
      "them the log-evidence changes by {:.2g} and moments by {:.2g} std, and {:.1g} of the mass lies at its "
      "border; "
      "use method transport or smc.",
      grid.per_axis, grid.evidence_change, grid.moment_change, grid.mass_at_border);
}

std::string verdict(const sampling::MetropolisResult& chains) {
  const std::string facts = fmt::format(
      "split R-hat of {} chains is at most {:.3f} (limit 1.01) and the smallest effective sample size {:.0f} "
      "of {} (at least 400), and the error of a standard deviation at most {:.1f} % (limit 2 %)",
      chains.chains, chains.r_hat.maxCoeff(), chains.effective_sizes.minCoeff(), chains.sample.points.rows(),
      100 * chains.std_errors.maxCoeff());
  if (chains.converged) return fmt::format("Trusted: {}.", facts);
  return fmt::format("Not trusted: the chains have not converged: {}; raise the number of samples.", facts);
}

std::string verdict(const sampling::RecycledImportanceResult& draws) {
  const double beta = draws.temperatures.back();
  const std::string facts = fmt::format(
      "{} weighted draws of {} rounds are worth {:.0f} independent ones; a mean is off by at most {:.2f} std "
      "(limit 0.1) and "
      "a "
      "standard deviation by {:.1f} % (limit 5 %), four standard errors each",
      draws.sample.points.rows(), draws.temperatures.size(), draws.sample.effective_size, draws.mean_error,
      100 * draws.deviation_error);
  if (draws.converged) return fmt::format("Trusted: {}.", facts);
  if (beta < 1)
    return fmt::format(
        "Not trusted: the draws did not get to the posterior: after {} rounds they are at temperature {:.2g} "
        "of 1; use method mcmc.",
        draws.temperatures.size(), beta);
  return fmt::format("Not trusted: {}; raise the number of samples, or use method mcmc.", facts);
}

std::string does_not_fit(double chi_squared, Eigen::Index count) {
  return fmt::format(
      " But the observations do not fit the model: at the most probable parameters χ² is {:.4g} for {} "
      "values; check model, units and noise.",
      chi_squared, count);
}

std::string pressed(const std::string& parameter, double share, double end) {
  return fmt::format(
      " But {:.0f} % of the posterior of {} lies next to the end of its prior, {:.4g}, which cuts it off: "
      "widen the prior, or find out why.",
      100 * share, parameter, end);
}

}  // namespace knothe::inference
