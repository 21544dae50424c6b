#pragma once
/// @file Importance sampling of many variables that are nearly Gaussian once a few are known: hierarchical
/// models, with a few parameters and a state for each datum.
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "knothe/sampling/log_density.hpp"
#include "knothe/sampling/weighted_sample.hpp"

namespace knothe::sampling {

struct ConditionalLaplaceOptions {
  /// Converged when the stated errors are below these; done when they are a fifth below.
  double mean_tolerance = 0.1, deviation_tolerance = 0.05;
  Eigen::Index first_draws = 4096, max_draws = 65536;  ///< each round takes as many again as there are
  Eigen::Index pilot_draws = 1024;                     ///< of the leading variables
  std::size_t max_leading = 3;
  double mode_mass = 1e-3;  ///< a second mode with this share of the mass counts
  std::uint64_t seed = 1;
};

/// Converged: and no second mode was found, and the draws are worth at least a tenth of their number.
struct ConditionalLaplaceResult : ImportanceResult {
  std::vector<Eigen::Index> leading;  ///< the variables drawn first
  bool second_mode_found = false;
};

/// Leading are the variables that change the curvature of the log-density in all of them most, as far as half
/// as much as the first of them. They are drawn from a mixture of Student's t, fitted to Laplace's
/// approximation of their marginal density (Tierney, Kadane 1986); the others from the Gaussian at the mode
/// that they have given the leading ones, found by Newton's method for each draw (Rue, Martino, Chopin 2009),
/// a tenth of them from Student's t of the same scale. The answer owes nothing to these approximations but how
/// even its weights are. A function of the target and the options alone. Errors: UsageError for a density
/// without second derivatives or with less than two variables; those of ModeSearch and of the target.
[[nodiscard]] ConditionalLaplaceResult conditional_laplace(LogDensity& target,
                                                           const ConditionalLaplaceOptions& options = {});

}  // namespace knothe::sampling
