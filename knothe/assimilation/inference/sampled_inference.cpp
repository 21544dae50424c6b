#include "knothe/assimilation/inference/sampled_inference.hpp"

#include <algorithm>

#include "knothe/posterior/solve.hpp"

namespace knothe::assimilation {

void by_markov_chains(PosteriorDensity& posterior, const InferenceOptions& options, InferenceResult& r) {
  const posterior::MetropolisResult chains = posterior::solve_by_chains(
      posterior, [&](const Eigen::MatrixXd& z) { return posterior.parameters(z); },
      {.samples = options.samples, .seed = options.seed, .progress = options.progress}, r);
  r.draws = r.points;
  r.chains = chains.chains;
  r.r_hat = chains.r_hat;
  r.effective_sizes = chains.effective_sizes;
  r.std_errors = chains.std_errors;
  r.acceptance = chains.acceptance;
  r.verdict = in_words(posterior::trust_of(chains));
}

void by_weighted_draws(PosteriorDensity& posterior, const model::ForwardModel& model,
                       const InferenceOptions& options, InferenceResult& r) {
  constexpr std::int64_t k_reserved_calls =
      750;  // that finding the most probable point takes afterwards, at most
  posterior::RecycledImportanceOptions draw_options;
  draw_options.max_evaluations =
      std::max<std::int64_t>(draw_options.max_evaluations, 2 * options.samples) - k_reserved_calls;
  draw_options.spent = [&] {
    const model::ModelCalls& calls = model.calls();
    return calls.evaluations + calls.gradients + calls.jacobians + calls.hessians;
  };
  draw_options.seed = options.seed;
  draw_options.progress = options.progress;
  const posterior::RecycledImportanceResult draws = posterior::solve_by_draws(
      posterior, [&](const Eigen::MatrixXd& z) { return posterior.parameters(z); }, draw_options, r);
  r.temperatures = draws.temperatures;
  r.verdict = in_words(posterior::trust_of(draws, draws.temperatures.back()));
}

}  // namespace knothe::assimilation
