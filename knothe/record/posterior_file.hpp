#pragma once
/// @file posterior.nc: the sequence of posteriors as NetCDF-4 in ArviZ's groups, and its reading back for
/// forecasts.
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/engine/step_result.hpp"
#include "knothe/assimilation/forecast/forecaster.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/data/datum.hpp"
#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::record {

/// What is kept of a step until the files are written.
struct KeptStep {
  assimilation::UpdateResult result;
  likelihood::Datum datum;  ///< the last of the step, with the noise that it was measured with
  std::vector<assimilation::NamedForecast> forecasts;  ///< without their densities
  Eigen::VectorXd bias;  ///< m, of the model at the sensors, to be added to it; empty: not corrected
};

/// `datum`: the last of the step, with the noise that it was measured with; `observed`: the model at the
/// sensors.
[[nodiscard]] KeptStep retain_step(const assimilation::StepResult& result, likelihood::Datum datum,
                                   const model::ObservedModel* observed);

/// What goes into the file.
struct PosteriorFile {
  const project::Project& project;
  const model::SeparatedModel& model;
  const likelihood::Measurements& measurements;
  std::span<const posterior::Prior> priors;  ///< in the order of the model's parameters
  std::span<const KeptStep> steps;           ///< at least one
  /// The model at the observed dofs (its first rows) and times; null: the model's own times.
  std::shared_ptr<const model::ObservedModel> observed;
  assimilation::Verdict verdict;  ///< of the run
};

/// What `draw_step` draws for a step.
struct StepDraws {
  Eigen::MatrixXd parameters;      ///< draws × d, no two the same
  Eigen::VectorXd log_likelihood;  ///< of the step's datum, by draw
  Eigen::MatrixXd predicted;  ///< n_obs × every `stride`-th draw, SI, with noise; NaN where not measured
};

/// Draws that weigh the same from a step's posterior, and what `observed` with its bias and the noise of the
/// datum says of each, at its first `rows` sensors. The same for the same step.
[[nodiscard]] StepDraws draw_step(const KeptStep& step, const model::ObservedModel& observed,
                                  std::span<const posterior::Prior> priors, Eigen::Index rows,
                                  Eigen::Index draws, Eigen::Index stride);

/// Groups as listed in docs/reference/formats.md, "Results folder". Atomic; IoError.
void write_posterior_file(const std::string& path, const PosteriorFile& file);

/// Reads the weighted points of the last step, its number and time; `parameters` must be those of the file,
/// in this order. Errors: DataError.
[[nodiscard]] assimilation::UpdateResult read_last_posterior(const std::string& path,
                                                             const std::vector<std::string>& parameters);

}  // namespace knothe::record
