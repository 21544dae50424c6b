#pragma once
/// @file From the plain values of the library's border to the engine: the way of the facade and of Python.
/// Not installed.
#include <string>
#include <vector>

#include "knothe/assimilation/engine/engine.hpp"
#include "knothe/library/assimilation.hpp"

namespace knothe::library {

/// Errors: those of `posterior::EarlierPosteriors`.
[[nodiscard]] std::vector<posterior::Prior> priors_of(const std::vector<Prior>& priors);

/// The model at the sensors. Errors: UsageError for sensors without a point each, for none at all, and for a
/// series that the model does not have; DataError for points outside it.
[[nodiscard]] model::ObservedModel observed(const model::SeparatedModel& model, const Sensors& sensors);

/// Of n = `sensors` values. UsageError unless there is one standard deviation for each, or their precision.
[[nodiscard]] likelihood::GaussianNoise noise_of(const Noise& noise, std::size_t sensors);

/// The model at the sensors, its parameters in the order of the priors, and its own error there; steps of
/// data are the model's. Errors: as of the constructor of Assimilation.
[[nodiscard]] assimilation::EngineSetup engine_setup(const std::string& model_file, const Sensors& sensors,
                                                     const Noise& noise, const std::vector<Prior>& priors,
                                                     const AssimilationOptions& options);

}  // namespace knothe::library
