#include "knothe/assimilation/bias/model_selection.hpp"

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

}  // namespace knothe::assimilation
