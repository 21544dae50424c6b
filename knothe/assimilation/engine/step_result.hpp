#pragma once
/// @file What the engine says of one step.
#include <Eigen/Core>
#include <chrono>
#include <optional>
#include <vector>

#include "knothe/assimilation/decide/decision.hpp"
#include "knothe/assimilation/forecast/forecast_scores.hpp"
#include "knothe/assimilation/forecast/forecaster.hpp"
#include "knothe/assimilation/monitor/model_selection.hpp"
#include "knothe/assimilation/update/robust_update.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"

namespace knothe::assimilation {

/// The posterior of all data up to a step, and what follows from it.
struct StepResult {
  UpdateResult update;                                ///< the posterior; monitor
  std::chrono::system_clock::time_point computed_at;  ///< when: of the wall clock
  std::vector<NamedForecast> forecasts;
  double forecast_us = 0;
  std::optional<Decision> decision;  ///< what to do next, where the project asks
  double decision_us = 0;
  /// False for a preview: the steps before have not been monitored yet, and what depends on their order
  /// (monitor, sensors, scores) is not told.
  bool followed = true;
  std::vector<ScoredForecast> scores;          ///< forecasts that came true with this step
  std::optional<SensorReport> sensors;         ///< of gating or a Student-t likelihood
  std::vector<Eigen::Index> stuck, absent;     ///< sensors that have stopped, independent noise only
  std::vector<ComparedModel> models;           ///< the candidates side by side; empty without any
  EstimatedBias bias;                          ///< where it is corrected
  std::vector<EstimatedError> lasting_errors;  ///< of the data together: an offset of a clock
  std::size_t model_version = 0;  ///< how often the model had been refined (project/refinement.hpp)
};

}  // namespace knothe::assimilation
