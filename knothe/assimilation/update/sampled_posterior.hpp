#pragma once
/// @file Posteriors by draws: what `smc` and `mcmc` are for every density, whoever asks.
#include <Eigen/Core>
#include <functional>

#include "knothe/assimilation/update/posterior.hpp"
#include "knothe/sampling/adaptive_metropolis.hpp"
#include "knothe/sampling/recycled_importance.hpp"

namespace knothe::assimilation {

/// From a density's own variables to the parameters, n × d each.
using ToParameters = std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>;

/// `mcmc`: adaptive Markov chains, their evidence by bridge sampling. Sets points, moments, quantiles,
/// evidence and trust. Errors: those of `adaptive_metropolis`.
sampling::MetropolisResult solve_by_chains(sampling::LogDensity& target, const ToParameters& to_parameters,
                                           const sampling::MetropolisOptions& options, Posterior& posterior);

/// `smc`: weighted draws that all count, along tempered densities. Sets the same. `options.variables` is set
/// here. Errors: those of `recycled_importance`.
sampling::RecycledImportanceResult solve_by_draws(sampling::LogDensity& target,
                                                  const ToParameters& to_parameters,
                                                  sampling::RecycledImportanceOptions options,
                                                  Posterior& posterior);

/// The part that all importance draws share; `temperature` of the last round.
void set_from_draws(const sampling::ImportanceResult& draws, const ToParameters& to_parameters,
                    double temperature, Posterior& posterior);

}  // namespace knothe::assimilation
