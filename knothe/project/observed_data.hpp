#pragma once
/// @file Measurements of every kind, as rows of one observed model at the times of the data.
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

struct ObservedData {
  /// Values and noise have a row per sensor: a displacement, or one of the scalars behind them.
  likelihood::Measurements measurements;
  std::shared_ptr<const model::ObservedModel> observed;
  std::vector<std::size_t> time_indices;  ///< of the observed model, per measured time
  Eigen::MatrixXd known;            ///< n_times × known parameters in the project's order: their values
  std::vector<std::string> unused;  ///< series of the file that nothing was made of: they have no std
};

/// What the project's sources recorded, into `measured`, at its times (of pictures, without their values so
/// far): series, and displacements, each as a series of a sensor of its own; then the standard deviations of
/// the project. Errors: DataError where a source has no time in common, a series that is there already, or
/// correlated noise; ProjectError for a standard deviation of a name that no series has.
void add_sources(const Project& project, likelihood::Measurements& measured);

/// The clock of a source, which joins those of `measured`; nothing where it is exact.
std::optional<std::size_t> add_clock(const DataSource& source, likelihood::Measurements& measured);

/// The sensors of the project, and those that its data bring.
[[nodiscard]] std::vector<model::ScalarObservation> sensors_of(const Project& project,
                                                               const likelihood::Measurements& measured);

/// The project's data file, or its fields. Errors: those of `read_measurements` and `measure_fields`.
[[nodiscard]] likelihood::Measurements read_recorded(const Project& project,
                                                     const model::ModelContents& model);

/// What of `measurements` the model says something about: displacements; series with a std that are named as
/// a sensor of the project or an output of the model. With `project.clock` the times are those that its
/// series tells, and its error is in the noise. Parameters that are known take the values of their series,
/// and the observed model is one of the others; errors of theirs are in the noise too. The model's
/// parameters: those of `priors` in order, then the known ones. `source`: what messages call the data.
/// Errors: DataError, ProjectError.
[[nodiscard]] ObservedData observe_data(const Project& project, const model::SeparatedModel& model,
                                        const std::vector<posterior::Prior>& priors,
                                        likelihood::Measurements measurements, const std::string& source);

}  // namespace knothe::project
