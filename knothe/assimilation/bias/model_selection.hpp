#pragma once
/// @file Which of several models made the data (Rubio et al. 2019, Eq. 21-23).
#include <string>
#include <vector>

namespace knothe::assimilation {

/// π(M_k | d) of Eq. 21 from the logarithms of the models' evidences, each model equally probable beforehand;
/// sums to 1. At least one, all finite.
[[nodiscard]] std::vector<double> model_probabilities(const std::vector<double>& log_evidences);

/// How strong evidence is, by the logarithm of a Bayes factor F (natural): "barely worth mentioning",
/// "substantial" (|log₁₀ F| ≥ ½), "strong" (1), "very strong" (1½), "decisive" (2). H. Jeffreys, Theory of
/// Probability, 1961, app. B.
[[nodiscard]] std::string jeffreys_scale(double log_bayes_factor);

}  // namespace knothe::assimilation
