#include "knothe/assimilation/monitor/model_selection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

namespace knothe::assimilation {

std::vector<double> model_probabilities(const std::vector<double>& log_evidences) {
  assert(!log_evidences.empty());
  const double largest = *std::max_element(log_evidences.begin(), log_evidences.end());
  std::vector<double> probability;
  double sum = 0;
  for (const double value : log_evidences) sum += probability.emplace_back(std::exp(value - largest));
  for (double& p : probability) p /= sum;
  return probability;
}

std::string jeffreys_scale(double log_bayes_factor) {
  const double decades = std::abs(log_bayes_factor) / std::numbers::ln10;
  if (decades < 0.5) return "barely worth mentioning";
  if (decades < 1) return "substantial";
  if (decades < 1.5) return "strong";
  return decades < 2 ? "very strong" : "decisive";
}

std::vector<ComparedModel> compare_models(const std::vector<std::string>& names,
                                          const std::vector<double>& log_evidences) {
  const std::vector<double> probability = model_probabilities(log_evidences);
  const double best = *std::max_element(log_evidences.begin(), log_evidences.end());
  std::vector<ComparedModel> models;
  for (std::size_t k = 0; k < names.size(); ++k) {
    const double factor = best - log_evidences[k];
    models.push_back({names[k], log_evidences[k], probability[k], factor, jeffreys_scale(factor)});
  }
  return models;
}

std::string comparison_text(const std::vector<ComparedModel>& models) {
  std::vector<ComparedModel> order = models;
  std::stable_sort(order.begin(), order.end(), [](const ComparedModel& a, const ComparedModel& b) {
    return a.log_evidence > b.log_evidence;
  });
  std::string text =
      fmt::format("most probable model: {} (probability {:.3g})", order[0].name, order[0].probability);
  for (std::size_t k = 1; k < order.size(); ++k) {
    text += fmt::format("\n  over {}: log Bayes factor {:.1f}, {} evidence", order[k].name,
                        order[k].log_bayes_factor, order[k].scale);
  }
  return text;
}

}  // namespace knothe::assimilation
