#pragma once
/// @file Adaptive importance sampling: a mixture of Student's t is fitted to tempered particles, then to its
/// own weighted draws, until the draws are good enough.
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>

#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior {

struct AdaptiveImportanceOptions {
  Eigen::Index particles = 800;  ///< of the tempered start, which finds the modes
  int max_moves = 12;            ///< of them at each temperature
  int attempts = 2;              ///< of the start; each has four times as many particles, twice the moves
  Eigen::Index first_draws = 8192, max_draws = 32768;  ///< of a round; each takes twice as many
  int max_rounds = 6;
  std::uint64_t seed = 1;
  /// The variables whose means and standard deviations count, from the density's own (n × d, in place).
  std::function<void(Eigen::MatrixXd&)> variables = {};
};

/// Converged: no mass is missed, either.
struct AdaptiveImportanceResult : ImportanceResult {
  double missed = 0;           ///< about: the share of the mass that the draws have missed
  std::size_t components = 0;  ///< of the mixture drawn from
};

/// For a density relative to N(0, I), or wider than it nowhere: the particles begin there (Del Moral, Doucet,
/// Jasra 2006), and 2 % of the draws come from there. Each round fits mixtures (Cappé, Douc, Guillin, Marin,
/// Robert 2008) to what the last one has drawn, with truncated weights (Ionides 2008), one for each group of
/// coordinates that depend on each other, and draws again. A fifth of the draws comes from mixtures fitted to
/// the target's flattened form, the square root of it and the reference: they reach the ends of ridges, which
/// a fit to the target thins out (defensive sampling, Hesterberg 1995). The answer owes nothing to fit and
/// groups but how even its weights are. A function of the target and the options alone. Errors: as
/// `TemperedParticles`.
[[nodiscard]] AdaptiveImportanceResult adaptive_importance(LogDensity& target,
                                                           const AdaptiveImportanceOptions& options = {});

}  // namespace knothe::posterior
