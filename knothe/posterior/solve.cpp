#include "knothe/posterior/solve.hpp"

#include <algorithm>

#include "knothe/posterior/draws/bridge_sampling.hpp"

namespace knothe::posterior {
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

void set_sampled_trust(const Trust& trust, Posterior& r) {
  r.set_trust(trust);
  r.tolerance_reached = trust.trusted;
}

}  // namespace

void set_from_map(const MapResult& map, const ImportanceCorrection& correction,
                  const ToParameters& to_parameters, Posterior& r) {
  set_points(to_parameters(correction.points), correction.weights, Method::transport, r);
  r.effective_sample_size = correction.ess;
  r.log_evidence = correction.log_evidence;
  r.log_evidence_error = correction.log_evidence_error;
  r.log_evidence_lower_bound = correction.map_log_evidence;
  r.map_order = map.order;
  r.variance_diagnostic = map.verified_diagnostic;
  r.tolerance_reached = map.tolerance_reached;
  r.second_mode_found = map.second_mode_found;
  r.set_trust(correction.trust, correction.trust.trusted ? map.reason : "");
}

Trust solve_by_grid(LogDensity& target, const ToParameters& to_parameters, const QuadratureOptions& options,
                    Posterior& r) {
  const QuadraturePosterior grid = tensor_quadrature(target, options);
  set_points(to_parameters(grid.points()), grid.weights, Method::grid, r);
  r.quantiles = to_parameters(grid.quantiles.transpose()).transpose();
  r.log_evidence = r.log_evidence_lower_bound = grid.log_evidence;
  r.log_evidence_error = grid.evidence_change;
  const Trust trust = trust_of(grid.figures());
  r.set_trust(trust);
  r.tolerance_reached = trust.trusted;
  return trust;
}

MetropolisResult solve_by_chains(LogDensity& target, const ToParameters& to_parameters,
                                 const MetropolisOptions& options, Posterior& r) {
  MetropolisResult chains = adaptive_metropolis(target, options);
  const double effective_size = chains.effective_sizes.minCoeff();
  set_points(to_parameters(chains.sample.points), chains.sample.weights, Method::markov_chain, r);
  r.effective_sample_size = std::min(1.0, effective_size / r.points.rows());
  const BridgeEstimate evidence = bridge_sampling(target, chains.sample.points, effective_size,
                                                  k_bridge_proposals, options.seed + k_bridge_seed);
  r.log_evidence = r.log_evidence_lower_bound = evidence.log_evidence;
  r.log_evidence_error = evidence.error;
  set_sampled_trust(trust_of(chains), r);
  return chains;
}

void set_from_draws(const ImportanceResult& draws, const ToParameters& to_parameters, double temperature,
                    Posterior& r) {
  const WeightedSample& sample = draws.sample;
  set_points(to_parameters(sample.points), sample.weights, Method::sequential_monte_carlo, r);
  r.effective_sample_size = sample.effective_size / sample.weights.size();
  r.log_evidence = r.log_evidence_lower_bound = sample.log_evidence;
  r.log_evidence_error = sample.log_evidence_error;
  set_sampled_trust(trust_of(draws, temperature), r);
}

RecycledImportanceResult solve_by_draws(LogDensity& target, const ToParameters& to_parameters,
                                        RecycledImportanceOptions options, Posterior& r) {
  options.variables = to_parameters;
  RecycledImportanceResult draws = recycled_importance(target, options);
  set_from_draws(draws, to_parameters, draws.temperatures.back(), r);
  return draws;
}

}  // namespace knothe::posterior
