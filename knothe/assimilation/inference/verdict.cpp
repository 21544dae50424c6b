#include "knothe/assimilation/inference/verdict.hpp"

#include <fmt/format.h>

#include <vector>

namespace knothe::assimilation {

std::string verdict(const posterior::MapResult& map, const posterior::ImportanceCorrection& answer,
                    const posterior::PriorTransform& transform) {
  posterior::Trust trust = answer.trust;
  trust.figures =
      fmt::format("map of order {}: {}{}{}", map.order, trust.figures,
                  map.missed.tempered_done || map.missed.scanned
                      ? ""
                      : " by ascents from several starts (mode_search = \"tempered\" looks further)",
                  map.tolerance_reached ? "" : "; the tolerance was missed, though: " + map.reason);
  if (map.second_mode.size() > 0) {
    std::vector<double> p;
    for (Eigen::Index k = 0; k < map.second_mode.size(); ++k)
      p.push_back(transform.prior(k).from_standard_normal(map.second_mode[k]).value);
    trust.reason += fmt::format("; there is a second mode near ({:.4g}), which the map does not cover",
                                fmt::join(p, ", "));
  }
  trust.reason += "; cross-check by method smc or mcmc";
  return in_words(trust);
}

std::string does_not_fit(double chi_squared, Eigen::Index count) {
  return fmt::format(
      "the observations do not fit the model: at the most probable parameters χ² is {:.4g} for {} "
      "values; check model, units and noise.",
      chi_squared, count);
}

std::string pressed(const std::string& parameter, double share, double end) {
  return fmt::format(
      "{:.0f} % of the posterior of {} lies next to the end of its prior, {:.4g}, which cuts it off: "
      "widen the prior, or find out why.",
      100 * share, parameter, end);
}

}  // namespace knothe::assimilation
