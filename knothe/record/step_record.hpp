#pragma once
/// @file One assimilated step as other programs read it: a line of JSON (keys are fixed by the project's
/// interfaces, section 4).
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/engine/step_result.hpp"

namespace knothe::record {

/// A verdict as lines and summary.json have it (docs/reference/formats.md).
[[nodiscard]] nlohmann::ordered_json verdict_record(const assimilation::Verdict& verdict);

/// The line of a step: posterior, map, evidence, data used, times, forecasts; sensors that are not to be
/// believed, scores of forecasts that came true, and models side by side where there are any. A preview is
/// without what the monitor says. `axes`: of the model, for names and physical values.
[[nodiscard]] nlohmann::ordered_json step_record(const assimilation::StepResult& result,
                                                 std::span<const model::Axis> axes);

/// The forecasts alone, by name. With `densities` the density of each is there too.
[[nodiscard]] nlohmann::ordered_json forecast_record(std::span<const assimilation::NamedForecast> forecasts,
                                                     bool densities);

/// Forecasts that have come true, by name: `observed`, its noise `std`, `units`, `time`, and for the steps
/// after which they were made `step`, `lead_time` (model time), `crps` and `probability`, P(measurement ≤
/// observed).
[[nodiscard]] nlohmann::ordered_json score_records(std::span<const assimilation::ScoredForecast> scores);

/// Beside the fixed keys, for figures: marginal densities of the parameters (`marginals`), densities of the
/// forecasts, and the crack lengths by Eq. 33 (`published`, quantiles at the same levels).
void add_densities(nlohmann::ordered_json& record, const std::vector<std::string>& parameters,
                   const std::vector<posterior::Prior>& priors, const assimilation::StepResult& result,
                   std::span<const assimilation::NamedForecast> published);

}  // namespace knothe::record
