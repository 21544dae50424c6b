#pragma once
/// @file Lazy maps: transport in many dimensions, where the data inform few directions (Bigoni, Zahm,
/// Spantini, Marzouk 2019, arXiv:1906.00031; Brennan, Bigoni, Zahm, Spantini, Marzouk 2020, NeurIPS).
///
/// T = A ∘ S_1 ∘ S_2 ∘ …, A from Laplace's approximation, S_l(x) = x + U_l(τ_l(U_lᵀx) − U_lᵀx) with r_l ≪ d
/// columns in U_l: the leading eigenvectors of
///   H = E[∇ log(T^♯π̄/ρ) (∇ log(T^♯π̄/ρ))ᵀ],
/// T being the composition so far. With τ the best map in these r directions the divergence left is at most
/// ½(λ_{r+1} + … + λ_d) (there, Proposition 1), which is how r is chosen. First derivatives of the density
/// suffice.
#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "knothe/sampling/log_density.hpp"
#include "knothe/transport/solve/map_solver.hpp"

namespace knothe::transport {

struct LazyMapOptions {
  double tolerance = 1e-2;                  ///< on the verified variance diagnostic (Eq. 9)
  int max_layers = 4;                       ///< 0: Laplace alone
  int max_rank = 4;                         ///< r of a layer, at most
  int max_order = 5;                        ///< of the triangular maps τ
  Eigen::Index diagnostic_points = 512;     ///< at which gradients are taken for H
  Eigen::Index training_points = 1024;      ///< at least; raised to 8 for each coefficient of a layer
  Eigen::Index verification_points = 1024;  ///< scrambled Sobol points, never used for training
  bool laplace = true;       ///< false: A = identity, for a target that is near N(0, I) as it is
  bool search_modes = true;  ///< look for a second mode
  double mode_mass = 1e-3;   ///< a mode with this share of the Laplace mass counts
  std::uint64_t seed = 1;
  TailRadii radii;
};

/// What a layer is and did.
struct LazyLayer {
  Eigen::VectorXd eigenvalues;  ///< of H, d, decreasing
  int rank = 0;
  int order = 0;
  double bound = 0;  ///< ½ Σ_{i>r} λ_i: the divergence that the layer may leave at best
  double weight_exponent =
      0;  ///< the points of H were weighted by (T^♯π̄/ρ)^this, 1 where weights are even enough
  double training_diagnostic = 0;
  double verified_diagnostic = 0;  ///< of the composition with this layer
};

struct LazyMapResult {
  ComposedMap map;  ///< T
  Eigen::VectorXd mode;
  double mode_log_density = 0;
  double laplace_diagnostic = 0;  ///< verified, before the first layer
  std::vector<LazyLayer> layers;  ///< those kept
  double half_trace = 0;  ///< ½ trace H at the end: a bound of the divergence left, where weights are even
  double training_objective = 0;  ///< of the last layer (0 without layers)
  double verified_diagnostic = 0;
  double verified_objective =
      0;  ///< Eq. 8 plus E log ρ on the verification points: −log evidence + divergence
  bool tolerance_reached = false;
  std::string reason;  ///< why the tolerance was not reached; empty if it was
  bool second_mode_found = false;
  Eigen::VectorXd second_mode;
  int iterations = 0;
  std::int64_t density_evaluations = 0;
  WeightedPoints verification;

  [[nodiscard]] double map_log_evidence() const { return -verified_objective; }
};

/// Errors: UsageError for options that make no sense or a density without first derivatives; NumericalError
/// as MapSolver::solve. Deterministic.
[[nodiscard]] LazyMapResult solve_lazy_map(sampling::LogDensity& target, const LazyMapOptions& options = {});

/// Moments, quantiles and evidence by importance weights on the verification points, as MapSolver::correct,
/// and `trusted` by the same rule. No further evaluations.
[[nodiscard]] ImportanceCorrection correct(const LazyMapResult& result);

}  // namespace knothe::transport
