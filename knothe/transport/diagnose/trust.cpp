#include "knothe/transport/diagnose/trust.hpp"

#include <fmt/format.h>

namespace knothe::transport {

Trust assess_trust(const TrustFigures& figures) {
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
  trust.trusted = trust.reason.empty();
  return trust;
}

}  // namespace knothe::transport
