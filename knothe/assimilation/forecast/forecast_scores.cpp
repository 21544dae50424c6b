#include "knothe/assimilation/forecast/forecast_scores.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::assimilation {
namespace {

constexpr Index k_samples = 256;  ///< a forecast is thinned to so many

/// E|X| of X ~ N(mean, std²).
double mean_distance(double mean, double std) {
  const double z = mean / std;
  return 2 * std * numerics::normal_pdf(z) + mean * (2 * numerics::normal_cdf(z) - 1);
}

}  // namespace

Score score_samples(std::span<const double> samples, std::span<const double> weights, double noise_std,
                    double observed) {
  assert(samples.size() == weights.size() && !samples.empty() && noise_std > 0);
  // E|X − y| − ½ E|X − X'|.
  double total = 0, to_observed = 0, spread = 0;
  Score score;
  for (Index i = 0; i < std::ssize(samples); ++i) {
    total += weights[i];
    to_observed += weights[i] * mean_distance(observed - samples[i], noise_std);
    score.probability += weights[i] * numerics::normal_cdf((observed - samples[i]) / noise_std);
    const double both = std::sqrt(2.0) * noise_std;
    spread += 0.5 * weights[i] * weights[i] * mean_distance(0, both);
    for (Index j = 0; j < i; ++j)
      spread += weights[i] * weights[j] * mean_distance(samples[i] - samples[j], both);
  }
  score.crps = to_observed / total - spread / (total * total);
  score.probability /= total;
  return score;
}

void ForecastScores::wait_for(const std::string& name, const std::string& units,
                              const model::ObservedModel& model, Index row, std::size_t time_index,
                              double std) {
  const Eigen::VectorXd coefficients = (model.space.row(row) * model.core[time_index]).transpose();
  waiting_.push_back({name,
                      units,
                      QuantityOfInterest(model.functions, model.lift(row, time_index), coefficients, 0),
                      row,
                      time_index,
                      model.time[time_index],
                      std,
                      {},
                      std::nullopt});
}

std::vector<ScoredForecast> ForecastScores::score(std::size_t step, std::size_t time_index,
                                                  const Eigen::Ref<const Eigen::VectorXd>& values) {
  std::vector<ScoredForecast> scored;
  for (Waiting& forecast : waiting_) {
    if (forecast.time_index != time_index || std::isnan(values[forecast.row])) continue;
    ScoredForecast result;
    result.name = forecast.name;
    result.units = forecast.units;
    result.time = forecast.time;
    result.observed = values[forecast.row];
    result.std = forecast.std;
    for (const Kept& kept : forecast.kept) {
      if (kept.step >= step) break;
      const std::vector<double> equal(kept.samples.size(), 1.0);
      const Score score = score_samples(kept.samples, equal, forecast.std, result.observed);
      result.step.push_back(kept.step);
      result.lead_time.push_back(forecast.time - kept.time);
      result.crps.push_back(score.crps);
      result.probability.push_back(std::clamp(score.probability, 0.0, 1.0));
    }
    scored.push_back(std::move(result));
    forecast.scored_at = step;
  }
  return scored;
}

void ForecastScores::forget_from(std::size_t step) {
  for (Waiting& forecast : waiting_) {
    std::erase_if(forecast.kept, [&](const Kept& kept) { return kept.step >= step; });
    if (forecast.scored_at && *forecast.scored_at >= step) forecast.scored_at.reset();
  }
}

void ForecastScores::add_posterior(std::size_t step, double time,
                                   const Eigen::Ref<const Eigen::MatrixXd>& points,
                                   const Eigen::Ref<const Eigen::VectorXd>& weights) {
  const auto waits = [&](const Waiting& forecast) {
    return !forecast.scored_at && (forecast.kept.empty() || forecast.kept.back().step < step);
  };
  if (std::none_of(waiting_.begin(), waiting_.end(), waits)) return;
  const Eigen::MatrixXd chosen =
      points(numerics::equal_draws(weights, std::min(k_samples, points.rows())), Eigen::all);
  for (Waiting& forecast : waiting_) {
    if (!waits(forecast)) continue;
    const Eigen::VectorXd samples = forecast.quantity.evaluate(chosen);
    forecast.kept.push_back({step, time, {samples.begin(), samples.end()}});
  }
}

}  // namespace knothe::assimilation
