#pragma once
/// @file The tables [forecast.NAME] of a project file.
#include <vector>

#include "knothe/assimilation/decide/decision.hpp"
#include "knothe/assimilation/forecast/forecast_specification.hpp"

namespace knothe::project {

struct Values;

/// All of them; complains of what they lack.
[[nodiscard]] std::vector<assimilation::ForecastSpecification> read_forecasts(Values& values);

/// The table [decide].
[[nodiscard]] assimilation::DecisionOptions read_decide(Values& values);

}  // namespace knothe::project
