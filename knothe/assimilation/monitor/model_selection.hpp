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

/// One of several models, after the same data.
struct ComparedModel {
  std::string name;
  double log_evidence = 0;      ///< log p(d₀ … d_i) under this model
  double probability = 0;       ///< given the data, all models equally probable beforehand
  double log_bayes_factor = 0;  ///< of the most probable model over this one
  std::string scale;            ///< what that amounts to on the scale of Jeffreys
};
/// Names and evidences in the same order, at least one.
[[nodiscard]] std::vector<ComparedModel> compare_models(const std::vector<std::string>& names,
                                                        const std::vector<double>& log_evidences);
/// The most probable model and by how much, in words, a line for each model.
[[nodiscard]] std::string comparison_text(const std::vector<ComparedModel>& models);

}  // namespace knothe::assimilation
