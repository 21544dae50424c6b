#pragma once
/// @file The tables [forecast.NAME] of a project file.
#include <string>
#include <vector>

#include "knothe/assimilation/decide/decision.hpp"
#include "knothe/assimilation/forecast/forecast_specification.hpp"
#include "knothe/model/reduced/model_file.hpp"

namespace knothe::project {

struct Values;

/// All of them; complains of what they lack.
[[nodiscard]] std::vector<assimilation::ForecastSpecification> read_forecasts(Values& values);

/// The table [decide].
[[nodiscard]] assimilation::DecisionOptions read_decide(Values& values);

/// The unit of a forecast's values; empty: none.
[[nodiscard]] std::string forecast_units(const model::ModelContents& model,
                                         const assimilation::ForecastSpecification& specification);

}  // namespace knothe::project
