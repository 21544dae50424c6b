#pragma once
/// @file Evidence and weighted moments from a map and the target it was made for.
#include <Eigen/Core>
#include <cstdint>

#include "knothe/sampling/log_density.hpp"
#include "knothe/transport/diagnose/moments.hpp"
#include "knothe/transport/solve/map_solver.hpp"

namespace knothe::transport {

struct EvidenceOptions {
  Eigen::Index points = 1024;  ///< per replicate
  int replicates = 16;  ///< independent randomisations of the quasi-random points: they give the error bars
  std::uint64_t seed = 1;
};

/// log ∫ π̄, twice.
struct EvidenceEstimate {
  /// E_ρ[log π̄∘T + log|det ∇T| − log ρ] (Rubio et al. 2019, Eq. 24): a lower bound, low by the divergence
  /// KL(T_♯ρ‖π).
  double map_log_evidence = 0;
  double map_log_evidence_error = 0;  ///< standard error of that mean (not its distance from the evidence)
  /// log E_ρ[π̄∘T |det ∇T| / ρ]: consistent, whatever the map, as long as it covers the support.
  double log_evidence = 0;
  double log_evidence_error = 0;  ///< standard error
  double ess = 0;                 ///< effective sample size of the weights as a fraction of the points
  double diagnostic = 0;  ///< ½ Var of the log-weights (Eq. 9): to leading order, how low the bound is
  std::int64_t density_evaluations = 0;
};

/// Errors: UsageError for another dimension of the target, fewer than 16 points, fewer than 2 replicates;
/// NumericalError where the target is zero at every point, and those of CheckedDensity.
[[nodiscard]] EvidenceEstimate estimate_evidence(const ComposedMap& map, sampling::LogDensity& target,
                                                 const EvidenceOptions& options = {});

/// The image of n scrambled Sobol points with moments matched, and their importance weights. Errors: as
/// above.
[[nodiscard]] WeightedPoints weighted_points(const ComposedMap& map, sampling::LogDensity& target,
                                             Eigen::Index n = 1024, std::uint64_t seed = 1);

/// exp(log-weight), scaled to the sum 1. `ess`: (Σw)²/(n Σw²).
[[nodiscard]] Eigen::VectorXd normalised_weights(const Eigen::VectorXd& log_weight, double* ess = nullptr);

}  // namespace knothe::transport
