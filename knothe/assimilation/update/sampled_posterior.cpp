#include "knothe/assimilation/update/sampled_posterior.hpp"

#include <algorithm>

#include "knothe/posterior/draws/bridge_sampling.hpp"

namespace knothe::assimilation {
namespace {

constexpr Eigen::Index k_bridge_proposals = 1024;
constexpr std::uint64_t k_bridge_seed = 0x627269;

void set_points(const Eigen::MatrixXd& p, const Eigen::VectorXd& weights, posterior::Method method,
                posterior::Posterior& r) {
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

void set_sampled_trust(const posterior::Trust& trust, posterior::Posterior& r) {
  r.set_trust(trust);
  r.tolerance_reached = trust.trusted;
}

}  // namespace

posterior::MetropolisResult solve_by_chains(posterior::LogDensity& target, const ToParameters& to_parameters,
                                            const posterior::MetropolisOptions& options,
                                            posterior::Posterior& r) {
  posterior::MetropolisResult chains = posterior::adaptive_metropolis(target, options);
  const double effective_size = chains.effective_sizes.minCoeff();
  set_points(to_parameters(chains.sample.points), chains.sample.weights, posterior::Method::markov_chain, r);
  r.effective_sample_size = std::min(1.0, effective_size / r.points.rows());
  const posterior::BridgeEstimate evidence = posterior::bridge_sampling(
      target, chains.sample.points, effective_size, k_bridge_proposals, options.seed + k_bridge_seed);
  r.log_evidence = r.log_evidence_lower_bound = evidence.log_evidence;
  r.log_evidence_error = evidence.error;
  set_sampled_trust(posterior::trust_of(chains), r);
  return chains;
}

void set_from_draws(const posterior::ImportanceResult& draws, const ToParameters& to_parameters,
                    double temperature, posterior::Posterior& r) {
  const posterior::WeightedSample& sample = draws.sample;
  set_points(to_parameters(sample.points), sample.weights, posterior::Method::sequential_monte_carlo, r);
  r.effective_sample_size = sample.effective_size / sample.weights.size();
  r.log_evidence = r.log_evidence_lower_bound = sample.log_evidence;
  r.log_evidence_error = sample.log_evidence_error;
  set_sampled_trust(posterior::trust_of(draws, temperature), r);
}

posterior::RecycledImportanceResult solve_by_draws(posterior::LogDensity& target,
                                                   const ToParameters& to_parameters,
                                                   posterior::RecycledImportanceOptions options,
                                                   posterior::Posterior& r) {
  options.variables = to_parameters;
  posterior::RecycledImportanceResult draws = posterior::recycled_importance(target, options);
  set_from_draws(draws, to_parameters, draws.temperatures.back(), r);
  return draws;
}

}  // namespace knothe::assimilation
