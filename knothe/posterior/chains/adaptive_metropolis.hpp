#pragma once
/// @file Adaptive Markov chain Monte Carlo for a log-density: the slow, general cross-check.
#include <cstdint>
#include <functional>

#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior {

struct MetropolisOptions {
  int chains = 4;
  Eigen::Index samples = 10000;  ///< kept, all chains together
  Eigen::Index warm_up = 0;      ///< per chain, adapting; 0: as many as are kept per chain, at least 1000
  /// Chains that have not converged go on, with every 2nd, 4th … draw kept, up to this (a power of 2).
  int max_thinning = 16;
  std::uint64_t seed = 1;
  /// Asked once the modes are known: how many steps each chain may take, all in all; empty: no limit. Where
  /// they are too few the warm-up takes at most half of them, and fewer draws are kept.
  std::function<Eigen::Index()> affordable_steps = {};
  /// Called now and then with the share done in [0, 1]; false interrupts (Interrupted is thrown).
  std::function<bool(double)> progress = {};
};

struct MetropolisResult {
  WeightedSample sample;            ///< equal weights, chain after chain
  Eigen::VectorXd r_hat;            ///< d, split, rank-normalised
  Eigen::VectorXd effective_sizes;  ///< d, the least of those for mean, bulk, tails and variance
  Eigen::VectorXd std_errors;       ///< d, relative standard errors of the standard deviations
  int thinning = 1;                 ///< steps from one kept draw to the next
  double acceptance = 0;            ///< after warm-up
  bool converged = false;           ///< all r_hat ≤ 1.01, effective sizes ≥ 400, std_errors ≤ 0.02
  int chains = 0;                   ///< the sample holds n/chains successive draws of each
};

/// Random-walk Metropolis with the covariance learnt during warm-up (Haario, Saksman, Tamminen 2001), scale
/// tuned to the acceptance that is best (Roberts, Rosenthal 2001), frozen afterwards; where the density gives
/// gradients, three of four steps are preconditioned Langevin steps (MALA) with bounded drift. Chains begin
/// over-dispersed around the modes found. All chains advance in one batch, so that a model behind the density
/// is called for several points at once. The same seed gives the same chains, bit by bit. Errors: UsageError
/// for options that make no sense, Interrupted, and those of ModeSearch and CheckedDensity.
[[nodiscard]] MetropolisResult adaptive_metropolis(LogDensity& target, const MetropolisOptions& options = {});

}  // namespace knothe::posterior
