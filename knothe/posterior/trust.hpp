#pragma once
/// @file The one place that decides whether the computation of a posterior is trusted, by whatever method,
/// and says on what that rests. Whether the answer may be used is another question (the verdict).
#include <Eigen/Core>
#include <string>

namespace knothe::posterior {

struct ImportanceResult;
struct MetropolisResult;

/// Largest verified variance diagnostic (Rubio et al. 2019, Eq. 9) and least effective sample size (fraction)
/// of a trusted result.
inline constexpr double k_trusted_diagnostic = 0.05;
inline constexpr double k_trusted_effective_sample_size = 0.9;

struct Trust {
  bool trusted = false;
  std::string figures;  ///< what the decision rests on: a clause without a full stop
  std::string reason;   ///< why not, and what to do: clauses joined by "; ". Empty if trusted
};

/// "Trusted: FIGURES." or "Not trusted: REASON."
[[nodiscard]] std::string in_words(const Trust& trust);

struct MapFigures {
  double verified_diagnostic = 0;    ///< on points that did not train the map
  double effective_sample_size = 1;  ///< of the importance weights, as a fraction
  bool mass_missed = false;          ///< a second mode, or mass that the map leaves out, was found
  std::string mass_missed_reason;    ///< how that was found: a clause
};
/// Trusted: verified diagnostic ≤ 0.05, effective sample size ≥ 0.9, no second mode. Figures that are not
/// numbers are not trusted.
[[nodiscard]] Trust trust_of(const MapFigures& figures);

/// Of a quadrature: what changes from every other node to all of them.
struct QuadratureFigures {
  double evidence_change = 0;  ///< of the log-evidence
  double moment_change = 0;    ///< of means and standard deviations, in standard deviations
  double line_change = 0;      ///< of every other line of one axis
  double mass_at_border = 0;   ///< share of the mass in the outermost layer
  Eigen::Index nodes_per_axis = 0;
};
[[nodiscard]] constexpr bool is_resolved(const QuadratureFigures& figures) {
  return figures.evidence_change <= 0.01 && figures.moment_change <= 0.01 && figures.line_change <= 0.1 &&
         figures.mass_at_border <= 1e-5;
}
/// Trusted: `is_resolved`.
[[nodiscard]] Trust trust_of(const QuadratureFigures& figures);

/// Trusted: converged, that is all split R-hat ≤ 1.01, effective sample sizes ≥ 400, relative errors of
/// standard deviations ≤ 2 %.
[[nodiscard]] Trust trust_of(const MetropolisResult& chains);

/// Heaviest tail (`tail_shape_of`) of variables whose standard deviations are trusted; at ½ they are
/// infinite.
inline constexpr double k_trusted_tail_shape = 0.43;
/// Why standard deviations are not trusted; empty where they are.
[[nodiscard]] std::string heavy_tail_in_words(double tail_shape);
/// Trusted: four standard errors of a mean are below 0.1 standard deviations, of a standard deviation below
/// 5 %, no tail as heavy as above, and no mass found beyond the draws. `temperature`: β of the last round,
/// below 1 where tempering did not reach the posterior.
[[nodiscard]] Trust trust_of(const ImportanceResult& draws, double temperature = 1);

/// Of a Gaussian taken for the posterior (Kalman filters), whose importance weights have these figures.
[[nodiscard]] Trust trust_of_gaussian(const MapFigures& figures);

}  // namespace knothe::posterior
