#pragma once
/// @file The evidence from draws of a Markov chain, which have none of their own.
#include <cstdint>

#include "knothe/posterior/log_density.hpp"

namespace knothe::posterior {

struct BridgeEstimate {
  double log_evidence = 0;
  double error = 0;  ///< standard error, Frühwirth-Schnatter 2004 with the draws' effective size
};

/// Meng and Wong 1996, with their optimal bridge function, between the draws (n × d, equal weights) and a
/// Gaussian with the moments of the first half of them; the second half makes the estimate. `effective_size`:
/// of all draws. Evaluates the target at the second half and at `proposals` new points. Errors: UsageError
/// for fewer than 100 draws or draws without spread.
[[nodiscard]] BridgeEstimate bridge_sampling(LogDensity& target,
                                             const Eigen::Ref<const Eigen::MatrixXd>& draws,
                                             double effective_size, Eigen::Index proposals,
                                             std::uint64_t seed);

}  // namespace knothe::posterior
