#include "knothe/assimilation/inference/sampled_inference.hpp"

#include <algorithm>

#include "knothe/posterior/solve.hpp"

namespace knothe::assimilation {
namespace {

/// That finding the most probable point takes afterwards, at most.
constexpr std::int64_t k_reserved_calls = 750;

}  // namespace

void by_markov_chains(PosteriorDensity& posterior, const ModelEvaluator& evaluator,
                      const InferenceOptions& options, InferenceResult& r) {
  posterior::MetropolisOptions chain_options{
      .samples = options.samples, .seed = options.seed, .progress = options.progress};
  if (evaluator.budget() != ModelEvaluator::k_no_budget)
    chain_options.affordable_steps = [&] {
      constexpr std::int64_t k_of_bridge = 1100;
      const Eigen::Index d = posterior.dimension();
      const std::int64_t of_gradient = evaluator.has_gradient()   ? ModelEvaluator::k_gradient_cost
                                       : evaluator.has_jacobian() ? d
                                                                  : 2 * d;
      const std::int64_t of_step = 1 + (posterior.available_derivatives() > 0 ? of_gradient : 0);
      const std::int64_t left = evaluator.budget() - evaluator.spent() - k_of_bridge - k_reserved_calls;
      return std::max<std::int64_t>(0, left / (of_step * chain_options.chains));
    };
  const posterior::MetropolisResult chains = posterior::solve_by_chains(
      posterior, [&](const Eigen::MatrixXd& z) { return posterior.parameters(z); }, chain_options, r);
  r.draws = r.points;
  r.chains = chains.chains;
  r.r_hat = chains.r_hat;
  r.effective_sizes = chains.effective_sizes;
  r.std_errors = chains.std_errors;
  r.acceptance = chains.acceptance;
  r.budget_spent = !chains.converged && bool(chain_options.affordable_steps);
  r.verdict = in_words(posterior::trust_of(chains));
}

void by_weighted_draws(PosteriorDensity& posterior, const ModelEvaluator& evaluator,
                       const InferenceOptions& options, const std::vector<posterior::Mode>& modes,
                       InferenceResult& r) {
  posterior::RecycledImportanceOptions draw_options;
  draw_options.modes = modes;
  const bool is_limited = evaluator.budget() != ModelEvaluator::k_no_budget;
  if (is_limited) {
    const std::int64_t left = evaluator.budget() - evaluator.spent(),
                       reserved = std::min(k_reserved_calls, left / 4);
    draw_options.max_evaluations = evaluator.budget() - reserved;
    draw_options.draws = std::clamp<std::int64_t>((left - reserved) / 3, 1, draw_options.draws);
  } else {
    draw_options.max_evaluations =
        std::max<std::int64_t>(draw_options.max_evaluations, 2 * options.samples) - k_reserved_calls;
  }
  draw_options.spent = [&] { return evaluator.spent(); };
  draw_options.seed = options.seed;
  draw_options.progress = options.progress;
  const posterior::RecycledImportanceResult draws = posterior::solve_by_draws(
      posterior, [&](const Eigen::MatrixXd& z) { return posterior.parameters(z); }, draw_options, r);
  r.temperatures = draws.temperatures;
  r.mean_error = draws.mean_error;
  r.deviation_error = draws.deviation_error;
  r.budget_spent = !r.trusted && (is_limited || evaluator.is_out_of_time());
  r.verdict = in_words(posterior::trust_of(draws, draws.temperatures.back()));
}

}  // namespace knothe::assimilation
