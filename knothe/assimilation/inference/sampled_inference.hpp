#pragma once
/// @file Inference by the samplers of room sampling. Private to this room.
#include "knothe/assimilation/inference/inference.hpp"
#include "knothe/posterior/mode_search.hpp"

namespace knothe::assimilation {

// Within the budget of `evaluator`, of whose calls all count.

/// Fills what adaptive_metropolis gives, and the evidence by bridge sampling.
void by_markov_chains(PosteriorDensity& posterior, const ModelEvaluator& evaluator,
                      const InferenceOptions& options, InferenceResult& r);
/// Fills what recycled_importance gives; `modes` that are known already.
void by_weighted_draws(PosteriorDensity& posterior, const ModelEvaluator& evaluator,
                       const InferenceOptions& options, const std::vector<posterior::Mode>& modes,
                       InferenceResult& r);

}  // namespace knothe::assimilation
