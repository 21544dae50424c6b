#pragma once
/// @file Tempered sequential Monte Carlo: particles go from N(0, s² I) to the target along π_β ∝ ρ_s^{1−β}
/// π̄^β.
#include <cstdint>
#include <functional>
#include <vector>

#include "knothe/sampling/log_density.hpp"
#include "knothe/sampling/weighted_sample.hpp"

namespace knothe::sampling {

struct SequentialMonteCarloOptions {
  Eigen::Index particles = 2000;
  double ess_share = 0.5;  ///< the next β keeps this effective share of the particles
  int max_moves =
      50;  ///< Metropolis moves per temperature, at most; they stop once particles have moved enough
  double initial_spread =
      1.5;  ///< s: the start is N(centre, s² I); wider than where the mass is thought to be
  Eigen::VectorXd centre = {};  ///< empty: 0
  std::uint64_t seed = 1;
  std::function<bool(double)> progress = {};  ///< with β; false interrupts
};

struct SequentialMonteCarloResult {
  WeightedSample sample;             ///< with evidence (a consistent estimate, also over several modes)
  std::vector<double> temperatures;  ///< β
  double acceptance = 0;             ///< of the last temperature
};

/// Del Moral, Doucet, Jasra 2006, with adaptive temperatures and covariance. Errors: as adaptive_metropolis.
[[nodiscard]] SequentialMonteCarloResult sequential_monte_carlo(
    LogDensity& target, const SequentialMonteCarloOptions& options = {});

}  // namespace knothe::sampling
