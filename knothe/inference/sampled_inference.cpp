#include "knothe/inference/sampled_inference.hpp"

#include "knothe/inference/bridge_sampling.hpp"
#include "knothe/inference/verdict.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/sampling/adaptive_metropolis.hpp"
#include "knothe/sampling/sequential_monte_carlo.hpp"

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

void by_particles(PosteriorDensity& posterior, const InferenceOptions& options, InferenceResult& r) {
  sampling::SequentialMonteCarloOptions particle_options;
  particle_options.seed = options.seed;
  particle_options.progress = options.progress;
  const sampling::SequentialMonteCarloResult particles =
      sampling::sequential_monte_carlo(posterior, particle_options);
  r.points = posterior.parameters(particles.sample.points);
  r.weights = particles.sample.weights;
  r.temperatures = particles.temperatures;
  r.acceptance = particles.acceptance;
  r.effective_sample_size =
      std::min(1.0, particles.sample.effective_size / static_cast<double>(r.points.rows()));
  r.log_evidence = particles.sample.log_evidence;
  r.log_evidence_error = particles.sample.log_evidence_error;
  r.trusted = r.tolerance_reached = particles.acceptance >= 0.05 && particles.sample.effective_size >= 400 &&
                                    particles.sample.log_evidence_error <= 0.2;
  r.verdict = verdict(particles, r.trusted);
  r.draws = numerics::resample(r.points, r.weights, options.samples, options.seed);
}

}  // namespace knothe::inference
