#include "knothe/inference/sampled_inference.hpp"

#include "knothe/inference/bridge_sampling.hpp"
#include "knothe/inference/verdict.hpp"
#include "knothe/sampling/adaptive_metropolis.hpp"
#include "knothe/sampling/recycled_importance.hpp"

namespace knothe::inference {
namespace {

constexpr Eigen::Index k_bridge_proposals = 1024;

}  // namespace

void by_markov_chains(PosteriorDensity& posterior, const InferenceOptions& options, InferenceResult& r) {
  sampling::MetropolisOptions chain_options;
  chain_options.samples = options.samples;
  chain_options.seed = options.seed;
  chain_options.progress = options.progress;
  const sampling::MetropolisResult chains = sampling::adaptive_metropolis(posterior, chain_options);
  r.points = posterior.parameters(chains.sample.points);
  r.weights = chains.sample.weights;
  r.draws = r.points;
  r.chains = chains.chains;
  r.r_hat = chains.r_hat;
  r.effective_sizes = chains.effective_sizes;
  r.std_errors = chains.std_errors;
  r.acceptance = chains.acceptance;
  r.effective_sample_size =
      std::min(1.0, chains.effective_sizes.minCoeff() / static_cast<double>(r.points.rows()));
  const BridgeEstimate evidence =
      bridge_sampling(posterior, chains.sample.points, chains.effective_sizes.minCoeff(), k_bridge_proposals,
                      options.seed + 0x627269);
  r.log_evidence = evidence.log_evidence;
  r.log_evidence_error = evidence.error;
  r.trusted = r.tolerance_reached = chains.converged;
  r.verdict = verdict(chains);
}

void by_weighted_draws(PosteriorDensity& posterior, const ForwardModel& model,
                       const InferenceOptions& options, InferenceResult& r) {
  constexpr std::int64_t k_reserved_calls = 750;  // calls that finding that point takes afterwards, at most
  sampling::RecycledImportanceOptions draw_options;
  draw_options.max_evaluations =
      std::max(draw_options.max_evaluations, 2 * options.samples) - k_reserved_calls;
  draw_options.spent = [&] {
    const ModelCalls& calls = model.calls();
    return calls.evaluations + calls.gradients + calls.jacobians + calls.hessians;
  };
  draw_options.seed = options.seed;
  draw_options.progress = options.progress;
  draw_options.variables = [&](const Eigen::MatrixXd& z) { return posterior.parameters(z); };
  const sampling::RecycledImportanceResult draws = sampling::recycled_importance(posterior, draw_options);
  r.points = posterior.parameters(draws.sample.points);
  r.weights = draws.sample.weights;
  r.temperatures = draws.temperatures;
  r.effective_sample_size = draws.sample.effective_size / static_cast<double>(r.points.rows());
  r.log_evidence = draws.sample.log_evidence;
  r.log_evidence_error = draws.sample.log_evidence_error;
  r.trusted = r.tolerance_reached = draws.converged;
  r.verdict = verdict(draws);
}

}  // namespace knothe::inference
