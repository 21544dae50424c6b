#pragma once
/// @file The tables [forecast.NAME] of a project file. Private to this room.
#include <vector>

#include "knothe/assimilation/forecast/forecaster.hpp"

namespace knothe::project {

struct Values;

/// All of them; complains of what they lack.
[[nodiscard]] std::vector<assimilation::ForecastSpecification> read_forecasts(Values& values);

}  // namespace knothe::project
