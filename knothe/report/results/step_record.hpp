#pragma once
/// @file One assimilated step as other programs read it: a line of JSON (keys are fixed by the project's
/// interfaces, section 4).
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/forecast/forecast_scores.hpp"
#include "knothe/forecast/forecaster.hpp"
#include "knothe/project/model_comparison.hpp"

namespace knothe::report {

/// The line of a step: posterior, map, evidence, data used, times, forecasts. `forecast_us`: time of the
/// forecasts.
[[nodiscard]] nlohmann::ordered_json step_record(const assimilation::UpdateResult& result,
                                                 std::span<const forecast::NamedForecast> forecasts,
                                                 double forecast_us);

/// The forecasts alone, by name. With `densities` the density of each is there too.
[[nodiscard]] nlohmann::ordered_json forecast_record(std::span<const forecast::NamedForecast> forecasts,
                                                     bool densities);

/// Models that are compared, by file: `log_evidence`, `probability`, `log_bayes_factor` of the most probable
/// one over it, and that in words.
[[nodiscard]] nlohmann::ordered_json model_records(const project::ModelComparison& comparison);

/// Forecasts that have come true, by name: `observed`, its noise `std`, `units`, `time`, and for the steps
/// after which they were made `step`, `lead_time` (model time), `crps` and `probability`, P(measurement ≤
/// observed).
[[nodiscard]] nlohmann::ordered_json score_records(std::span<const forecast::ScoredForecast> scores);

/// Beside the fixed keys, for figures: marginal densities of the parameters (`marginals`), densities of the
/// forecasts, and the direct forecasts of crack lengths (quantiles at the same levels).
void add_densities(nlohmann::ordered_json& record, const std::vector<std::string>& parameters,
                   const std::vector<assimilation::Prior>& priors, const assimilation::Posterior& posterior,
                   std::span<const forecast::NamedForecast> forecasts,
                   std::span<const forecast::NamedForecast> direct);

}  // namespace knothe::report
