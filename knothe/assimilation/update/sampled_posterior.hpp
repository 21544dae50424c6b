#pragma once
/// @file Posteriors by draws: what `smc` and `mcmc` are for every density, whoever asks.
#include <Eigen/Core>
#include <functional>

#include "knothe/posterior/chains/adaptive_metropolis.hpp"
#include "knothe/posterior/draws/recycled_importance.hpp"
#include "knothe/posterior/posterior.hpp"

namespace knothe::assimilation {

/// From a density's own variables to the parameters, n × d each.
using ToParameters = std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>;

/// `mcmc`: adaptive Markov chains, their evidence by bridge sampling. Sets points, moments, quantiles,
/// evidence and trust. Errors: those of `adaptive_metropolis`.
posterior::MetropolisResult solve_by_chains(posterior::LogDensity& target, const ToParameters& to_parameters,
                                            const posterior::MetropolisOptions& options,
                                            posterior::Posterior& posterior);

/// `smc`: weighted draws that all count, along tempered densities. Sets the same. `options.variables` is set
/// here. Errors: those of `recycled_importance`.
posterior::RecycledImportanceResult solve_by_draws(posterior::LogDensity& target,
                                                   const ToParameters& to_parameters,
                                                   posterior::RecycledImportanceOptions options,
                                                   posterior::Posterior& posterior);

/// The part that all importance draws share; `temperature` of the last round.
void set_from_draws(const posterior::ImportanceResult& draws, const ToParameters& to_parameters,
                    double temperature, posterior::Posterior& posterior);

}  // namespace knothe::assimilation
