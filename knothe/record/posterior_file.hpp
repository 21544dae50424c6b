#pragma once
/// @file posterior.nc: the sequence of posteriors as NetCDF-4 in ArviZ's groups, and its reading back for
/// forecasts.
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/engine/step_result.hpp"
#include "knothe/assimilation/forecast/forecaster.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/data/datum.hpp"
#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/model/compress/snapshots.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::record {

/// What is kept of a step until the files are written.
struct KeptStep {
  assimilation::UpdateResult result;
  likelihood::Datum datum;  ///< the last of the step, with the noise that it was measured with
  std::vector<assimilation::NamedForecast> forecasts;  ///< without their densities
  Eigen::VectorXd bias;  ///< m, of the model at the sensors, to be added to it; empty: not corrected
  /// Of the values of the step, to be added to the prediction: its own error (a motion, a clock) as the
  /// residual shows it; empty: none.
  Eigen::VectorXd error = {};
};

/// `datum`: the last of the step, with the noise that it was measured with; `observed`: the model at the
/// sensors.
[[nodiscard]] KeptStep retain_step(const assimilation::StepResult& result, likelihood::Datum datum,
                                   const model::ObservedModel* observed);

/// What goes into the file.
struct PosteriorFile {
  std::string project;  ///< text of the project file
  std::uint64_t seed = 0;
  std::span<const model::Axis> axes;         ///< of the parameters
  std::span<const posterior::Prior> priors;  ///< in the order of the axes
  const model::ObservedModel& observed;      ///< the model at the sensors and at the times of the data
  const model::Sensors& sensors;
  const std::map<std::string, likelihood::MeasuredSeries>&
      series;                              ///< their units; those that are not observed
  const likelihood::GaussianNoise& noise;  ///< of the sensors
  std::span<const KeptStep> steps;         ///< at least one
  assimilation::Verdict verdict;           ///< of the run
  Eigen::Index draws = 250;                ///< of each of the four chains
};

/// Groups as listed in docs/reference/formats.md, "Results folder". Atomic; IoError.
void write_posterior_file(const std::string& path, const PosteriorFile& file);

/// Reads the weighted points of the last step, its number and time; `parameters` must be those of the file,
/// in this order. Errors: DataError.
[[nodiscard]] assimilation::UpdateResult read_last_posterior(const std::string& path,
                                                             const std::vector<std::string>& parameters);

}  // namespace knothe::record
