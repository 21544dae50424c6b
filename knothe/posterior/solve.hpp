#pragma once
/// @file From a log-density to its posterior: what each method is for every density, whoever asks.
#include <Eigen/Core>
#include <functional>

#include "knothe/posterior/chains/adaptive_metropolis.hpp"
#include "knothe/posterior/draws/recycled_importance.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/posterior.hpp"
#include "knothe/posterior/quadrature/tensor_quadrature.hpp"

namespace knothe::posterior {

/// From a density's own variables to the parameters, n × d each.
using ToParameters = std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>;

// Each sets method, points, weights, moments, quantiles, evidence, diagnostics and trust of `posterior`.

/// `transport`: from a map and its importance correction (`MapSolver::solve`, `correct`).
void set_from_map(const MapResult& map, const ImportanceCorrection& correction,
                  const ToParameters& to_parameters, Posterior& posterior);

/// `grid`: quadrature, in variables that the parameters increase with, each alone.
Trust solve_by_grid(LogDensity& target, const ToParameters& to_parameters, const QuadratureOptions& options,
                    Posterior& posterior);

/// `mcmc`: adaptive Markov chains, their evidence by bridge sampling. Errors: those of `adaptive_metropolis`.
MetropolisResult solve_by_chains(LogDensity& target, const ToParameters& to_parameters,
                                 const MetropolisOptions& options, Posterior& posterior);

/// `smc`: weighted draws that all count, along tempered densities. `options.variables` is set here. Errors:
/// those of `recycled_importance`.
RecycledImportanceResult solve_by_draws(LogDensity& target, const ToParameters& to_parameters,
                                        RecycledImportanceOptions options, Posterior& posterior);

/// The part that all importance draws share; `temperature` of the last round.
void set_from_draws(const ImportanceResult& draws, const ToParameters& to_parameters, double temperature,
                    Posterior& posterior);

}  // namespace knothe::posterior
