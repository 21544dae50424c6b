#include "knothe/assimilation/update/sampled_posterior.hpp"

#include <algorithm>

#include "knothe/sampling/bridge_sampling.hpp"

namespace knothe::assimilation {
namespace {

constexpr Eigen::Index k_bridge_proposals = 1024;
constexpr std::uint64_t k_bridge_seed = 0x627269;

void set_points(const Eigen::MatrixXd& p, const Eigen::VectorXd& weights, Method method, Posterior& r) {
  r.method = method;
  r.points = p;
  r.weights = weights;
  r.summarise();
  r.quantiles = numerics::weighted_quantiles(r.points, r.weights);
  r.map_mean = r.mean;
  r.map_covariance = r.covariance;
  r.map_order = 0;
  r.variance_diagnostic = 0;
  r.second_mode_found = r.by_quadrature = false;
}

void set_sampled_trust(const sampling::Trust& trust, Posterior& r) {
  r.set_trust(trust);
  r.tolerance_reached = trust.trusted;
}

}  // namespace

sampling::MetropolisResult solve_by_chains(sampling::LogDensity& target, const ToParameters& to_parameters,
                                           const sampling::MetropolisOptions& options, Posterior& r) {
  sampling::MetropolisResult chains = sampling::adaptive_metropolis(target, options);
  const double effective_size = chains.effective_sizes.minCoeff();
  set_points(to_parameters(chains.sample.points), chains.sample.weights, Method::markov_chain, r);
  r.effective_sample_size = std::min(1.0, effective_size / static_cast<double>(r.points.rows()));
  const sampling::BridgeEstimate evidence = sampling::bridge_sampling(
      target, chains.sample.points, effective_size, k_bridge_proposals, options.seed + k_bridge_seed);
  r.log_evidence = r.log_evidence_lower_bound = evidence.log_evidence;
  r.log_evidence_error = evidence.error;
  set_sampled_trust(sampling::trust_of(chains), r);
  return chains;
}

void set_from_draws(const sampling::ImportanceResult& draws, const ToParameters& to_parameters,
                    double temperature, Posterior& r) {
  const sampling::WeightedSample& sample = draws.sample;
  set_points(to_parameters(sample.points), sample.weights, Method::sequential_monte_carlo, r);
  r.effective_sample_size = sample.effective_size / static_cast<double>(sample.weights.size());
  r.log_evidence = r.log_evidence_lower_bound = sample.log_evidence;
  r.log_evidence_error = sample.log_evidence_error;
  set_sampled_trust(sampling::trust_of(draws, temperature), r);
}

sampling::RecycledImportanceResult solve_by_draws(sampling::LogDensity& target,
                                                  const ToParameters& to_parameters,
                                                  sampling::RecycledImportanceOptions options, Posterior& r) {
  options.variables = to_parameters;
  sampling::RecycledImportanceResult draws = sampling::recycled_importance(target, options);
  set_from_draws(draws, to_parameters, draws.temperatures.back(), r);
  return draws;
}

}  // namespace knothe::assimilation
