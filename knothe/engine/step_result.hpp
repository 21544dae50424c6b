#pragma once
/// @file What the engine says of one step.
#include <Eigen/Core>
#include <chrono>
#include <optional>
#include <vector>

#include "knothe/assimilation/bias/model_selection.hpp"
#include "knothe/assimilation/update/robust_update.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/forecast/forecast_scores.hpp"
#include "knothe/forecast/forecaster.hpp"

namespace knothe::engine {

/// The posterior of all data up to a step, and what follows from it.
struct StepResult {
  assimilation::UpdateResult update;                  ///< the posterior; monitor
  std::chrono::system_clock::time_point computed_at;  ///< when: of the wall clock
  std::vector<forecast::NamedForecast> forecasts;
  double forecast_us = 0;
  /// False for a preview: the steps before have not been monitored yet, and what depends on their order
  /// (monitor, sensors, scores) is not told.
  bool followed = true;
  std::vector<forecast::ScoredForecast> scores;       ///< forecasts that came true with this step
  std::optional<assimilation::SensorReport> sensors;  ///< of gating or a Student-t likelihood
  std::vector<Eigen::Index> stuck, absent;            ///< sensors that have stopped, independent noise only
  std::vector<assimilation::ComparedModel> models;    ///< the candidates side by side; empty without any
  /// The correction of the model's bias, where it is on: as what is to be added to the model's functions w (a
  /// field), or at the sensors (m). Else empty.
  Eigen::VectorXd bias_functions, bias_sensors;
  std::size_t model_version = 0;  ///< how often the model had been refined (project/refinement.hpp)
};

}  // namespace knothe::engine
