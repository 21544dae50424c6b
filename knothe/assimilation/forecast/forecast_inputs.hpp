#pragma once
/// @file What forecasts take from a model: its prediction at a time, its outputs, its elastic cracks.
#include <string>
#include <vector>

#include "knothe/assimilation/forecast/crack_bridge.hpp"
#include "knothe/assimilation/forecast/forecast_specification.hpp"
#include "knothe/assimilation/forecast/horizon.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::assimilation {

/// The prediction at a step of the model.
[[nodiscard]] LinearPrediction at_step(const model::ObservedModel& model, std::size_t step);

/// The output that a forecast needs; DataError where the model lacks it.
[[nodiscard]] const model::SnapshotOutput& find_output(const model::SeparatedModel& model,
                                                       const std::string& name, const std::string& forecast);
/// Displacement of the load at each time of the model; it does not depend on the parameters.
[[nodiscard]] std::vector<double> imposed_displacements(const model::SeparatedModel& model,
                                                        const std::string& forecast);
/// Nodes of the model's parameter grid.
[[nodiscard]] std::vector<std::vector<double>> axis_nodes(const model::SeparatedModel& model);

/// The model at the point whose displacement is forecast.
[[nodiscard]] model::ObservedModel observe_point(const model::SeparatedModel& model,
                                                 const ForecastSpecification& specification);

/// The elastic cracks at the measured dofs; DataError where the model lacks them.
[[nodiscard]] CrackMetaModel elastic_cracks(const model::SeparatedModel& model, const model::Dofs& seen,
                                            const std::string& forecast);
[[nodiscard]] CrackBridgeOptions bridge_options(const ForecastSpecification& specification);

}  // namespace knothe::assimilation
