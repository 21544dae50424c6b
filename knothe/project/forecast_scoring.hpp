#pragma once
/// @file Which forecasts of a project come true within its data.
#include "knothe/assimilation/forecast/forecast_scores.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::project {

/// The forecasts whose horizon is a time of the data (to 1e-6 of a step) and whose quantity is measured
/// there: a displacement at a sensor's point (to 1e-6 m), or an output that is one of the series. Crack
/// lengths are not.
[[nodiscard]] assimilation::ForecastScores forecasts_to_score(const Project& project,
                                                              const UpdateSetup& setup);

}  // namespace knothe::project
