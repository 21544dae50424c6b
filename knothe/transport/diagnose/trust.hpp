#pragma once
/// @file The one place that decides whether a result is trusted, and says why not.
#include <string>

namespace knothe::transport {

/// Largest verified variance diagnostic (Rubio et al. 2019, Eq. 9) and least effective sample size (fraction)
/// of a trusted result.
inline constexpr double k_trusted_diagnostic = 0.05;
inline constexpr double k_trusted_effective_sample_size = 0.9;

/// What the decision rests on.
struct TrustFigures {
  double verified_diagnostic = 0;    ///< on points that did not train the map
  double effective_sample_size = 1;  ///< of the importance weights, as a fraction
  bool mass_missed = false;          ///< a second mode, or mass that the map leaves out, was found
  std::string mass_missed_reason;    ///< how that was found: a clause
};

struct Trust {
  bool trusted = false;
  std::string reason;  ///< why it is not: clauses joined by "; ", without a full stop. Empty if trusted
};

/// Trusted: verified diagnostic ≤ 0.05, effective sample size ≥ 0.9, no second mode. Figures that are not
/// numbers are not trusted.
[[nodiscard]] Trust assess_trust(const TrustFigures& figures);

}  // namespace knothe::transport
