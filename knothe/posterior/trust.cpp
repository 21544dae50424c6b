#include "knothe/posterior/trust.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/posterior/chains/adaptive_metropolis.hpp"
#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior {

std::string in_words(const Trust& trust) {
  return trust.trusted ? fmt::format("Trusted: {}.", trust.figures)
                       : fmt::format("Not trusted: {}.", trust.reason);
}

Trust trust_of(const MapFigures& figures) {
  Trust trust;
  const auto add = [&](const std::string& clause) {
    trust.reason += (trust.reason.empty() ? "" : "; ") + clause;
  };
  if (!(figures.verified_diagnostic <= k_trusted_diagnostic))
    add(fmt::format("the variance diagnostic on independent points is {:.2g}, above {}",
                    figures.verified_diagnostic, k_trusted_diagnostic));
  if (!(figures.effective_sample_size >= k_trusted_effective_sample_size))
    add(fmt::format("the effective sample size is {:.3g} % of the points, below {:.0f} %",
                    100 * figures.effective_sample_size, 100 * k_trusted_effective_sample_size));
  if (figures.mass_missed)
    add(figures.mass_missed_reason.empty() ? "a second mode was found" : figures.mass_missed_reason);
  trust.figures = fmt::format(
      "variance diagnostic {:.2g} on independent points (limit {}), effective sample "
      "size {:.1f} % (at least {:.0f} %), no second mode found",
      figures.verified_diagnostic, k_trusted_diagnostic, 100 * figures.effective_sample_size,
      100 * k_trusted_effective_sample_size);
  trust.trusted = trust.reason.empty();
  return trust;
}

Trust trust_of(const QuadratureFigures& figures) {
  Trust trust;
  trust.figures = fmt::format(
      "from every other to all of the {} nodes per axis the log-evidence changes by {:.2g} and moments by "
      "{:.2g} σ; {:.1g} of the mass lies at the border of the grid",
      figures.nodes_per_axis, figures.evidence_change, figures.moment_change, figures.mass_at_border);
  trust.trusted = is_resolved(figures);
  if (!trust.trusted)
    trust.reason =
        "the grid does not resolve the posterior: " + trust.figures + "; use method transport or smc";
  return trust;
}

Trust trust_of(const MetropolisResult& chains) {
  Trust trust;
  trust.figures = fmt::format(
      "split R-hat of {} chains at most {:.3f} (limit 1.01), smallest effective sample size {:.0f} of {} (at "
      "least 400), error of a standard deviation at most {:.1f} % (limit 2 %)",
      chains.chains, chains.r_hat.maxCoeff(), chains.effective_sizes.minCoeff(), chains.sample.points.rows(),
      100 * chains.std_errors.maxCoeff());
  trust.trusted = chains.converged;
  if (!trust.trusted)
    trust.reason = "the chains have not converged: " + trust.figures + "; raise the number of samples";
  return trust;
}

std::string heavy_tail_in_words(double tail_shape) {
  if (tail_shape <= k_trusted_tail_shape) return {};
  return fmt::format(
      "a tail is so heavy (it falls as distance^-{:.1f}; a standard deviation is infinite from 2 on) that "
      "standard deviations are infinite or barely finite: use the quantiles, which hold",
      1 / tail_shape);
}

Trust trust_of(const ImportanceResult& draws, double temperature) {
  Trust trust;
  trust.figures = fmt::format(
      "effective sample size {:.0f} of {}; Monte Carlo error (4 s.e.): means {:.2f} σ (limit 0.1), standard "
      "deviations {:.1f} % (limit 5 %)",
      draws.sample.effective_size, draws.sample.weights.size(), draws.mean_error,
      100 * draws.deviation_error);
  trust.trusted = draws.converged && !draws.mass_beyond && draws.tail_shape <= k_trusted_tail_shape;
  if (trust.trusted) return trust;
  trust.reason = heavy_tail_in_words(draws.tail_shape);
  if (!trust.reason.empty()) return trust;
  if (draws.converged && draws.mass_beyond)
    trust.reason =
        "walks from the outermost draws still find mass that hardly any draw stands for; raise evaluations, "
        "or "
        "choose a wider region under [parameters]";
  else
    trust.reason = temperature < 1 ? fmt::format(
                                         "tempering stopped before the posterior, at temperature "
                                         "{:.2g} of 1; raise evaluations, or use method mcmc",
                                         std::min(temperature, 0.99))
                                   : trust.figures + "; raise evaluations, or use method mcmc";
  return trust;
}

Trust trust_of_gaussian(const MapFigures& figures) {
  Trust trust = trust_of(figures);
  if (!trust.trusted) trust.reason = "the posterior is not the Gaussian of the filter: " + trust.reason;
  return trust;
}

}  // namespace knothe::posterior
