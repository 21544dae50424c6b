#pragma once
/// @file From a project file to everything a sequential update needs.
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "knothe/assimilation/decide/decider.hpp"
#include "knothe/assimilation/forecast/forecaster.hpp"
#include "knothe/assimilation/update/problem.hpp"
#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/likelihood/data/plausible_range.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/project/picture_measurements.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

struct UpdateSetup {
  model::SeparatedModel model;
  likelihood::Measurements measurements;
  assimilation::Problem problem;                  ///< parameters in the project file's order
  std::vector<std::size_t> time_indices;          ///< of the observed model, per measured time
  std::shared_ptr<PictureMeasurements> pictures;  ///< where data come from pictures, one by one; else null
  std::vector<std::string> unused;                ///< series of the data that are not used: they have no std
  Eigen::MatrixXd known;  ///< n_times × known parameters: their recorded values, unless the model has them
};

/// Reads model and data, and brings the model's parameters into the project file's order. Throws ProjectError
/// where the parameters are not the model's, DataError for what the files lack. ProjectError, or UsageError
/// where only the data tell, for what does not go together (`assimilation/update/compatibility.hpp`).
[[nodiscard]] UpdateSetup set_up(const Project& project);

/// Model and data read again, the model perhaps another one; the pictures are those of before, which go on.
/// `online`: for the service, in which every time of the model is a step.
[[nodiscard]] UpdateSetup set_up_again(const Project& project, std::shared_ptr<PictureMeasurements> pictures,
                                       bool online);

/// The same for the service: ProjectError for what it cannot do (a measured clock, forces, gauges). With
/// [serve] watch_pictures or [serve.camera] the sensors are those of pictures that are still to come.
[[nodiscard]] UpdateSetup set_up_online(const Project& project);

/// The separated model with its parameters in the project file's order. ProjectError where they are not the
/// model's, or a prior has no mass in the model's box.
[[nodiscard]] model::SeparatedModel load_model(const Project& project);

/// The forecasts that the project asks for. ProjectError, at the table of the forecast, where the file is to
/// blame; DataError for what the model lacks.
[[nodiscard]] assimilation::Forecaster make_forecaster(const Project& project, const UpdateSetup& setup);

/// What decides on the next action, where the project asks for it. Errors likewise.
[[nodiscard]] std::optional<assimilation::Decider> make_decider(const Project& project,
                                                                const UpdateSetup& setup);

/// Which values the service takes for measurements: from [serve.limits], and the model where that says
/// nothing. ProjectError where it names a series that is not measured.
[[nodiscard]] likelihood::PlausibleRange serve_limits(const Project& project, const UpdateSetup& setup);

/// The noise of a picture with that of the series beside it, which `measurements` have.
[[nodiscard]] likelihood::GaussianNoise with_series_noise(const likelihood::GaussianNoise& of_picture,
                                                          const likelihood::Measurements& measurements);

/// `noise` with the model's own error at each step of the data besides. UsageError where R is correlated and
/// what the error's modes leave out would take a dense matrix of more than 1000 rows.
[[nodiscard]] likelihood::NoiseModel with_truncation(const likelihood::NoiseModel& noise,
                                                     const model::ObservedTruncation& error);

}  // namespace knothe::project
