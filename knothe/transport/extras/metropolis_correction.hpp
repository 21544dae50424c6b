#pragma once
/// @file Exact samples through an imperfect map: independence Metropolis with proposals T(x), x ~ N(0, I).
#include <Eigen/Core>
#include <cstdint>
#include <functional>

#include "knothe/sampling/log_density.hpp"
#include "knothe/transport/map/composed_map.hpp"

namespace knothe::transport {

struct MetropolisCorrectionOptions {
  int chains = 4;
  Eigen::Index samples = 10000;  ///< kept, all chains together; rounded up to a multiple of `chains`
  Eigen::Index warm_up = 100;    ///< per chain, not kept
  Eigen::Index batch = 4096;     ///< proposals that the target sees at once; the result does not depend on it
  std::uint64_t seed = 1;
  /// Called after each batch with the share done in [0, 1]; false interrupts (Interrupted is thrown).
  std::function<bool(double)> progress;
};

struct MetropolisCorrectionResult {
  Eigen::MatrixXd points;     ///< z, n × d, chain after chain; each follows the target
  Eigen::MatrixXd reference;  ///< x with T(x) = z
  int chains = 0;
  double acceptance = 0;            ///< share of proposals accepted, 1 for an exact map
  Eigen::VectorXd r_hat;            ///< d, split, rank-normalised
  Eigen::VectorXd effective_sizes;  ///< d, in independent draws
  Eigen::Index longest_stay =
      0;                   ///< most successive draws at one point: the sign of a tail that the map misses
  bool converged = false;  ///< all r_hat ≤ 1.01 and effective sizes ≥ 400
  std::int64_t density_evaluations = 0;
};

/// Metropolis–Hastings with proposals independent of the state (Tierney 1994; with a map, Parno and Marzouk
/// 2018, section 6.1): T(x') is accepted with probability min(1, w(x')/w(x)), w = π̄∘T |det ∇T| / ρ. Exact for
/// every map that covers the support. Proposals do not depend on the chain, so all are evaluated in batches.
/// Deterministic by the seed. Errors: UsageError for options that make no sense or another dimension;
/// NumericalError if the target is zero at every proposal.
[[nodiscard]] MetropolisCorrectionResult metropolis_correction(
    const ComposedMap& map, sampling::LogDensity& target, const MetropolisCorrectionOptions& options = {});

}  // namespace knothe::transport
