#pragma once
/// @file What forecasts take from a model: its prediction at a time, its outputs, its elastic cracks.
#include <memory>
#include <span>
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

/// The unit of a forecast's values; empty: none.
[[nodiscard]] std::string forecast_units(const model::ModelContents& model,
                                         const ForecastSpecification& specification);

/// Displacement of the load at each time of the model; it does not depend on the parameters.
[[nodiscard]] std::vector<double> imposed_displacements(const model::SeparatedModel& model,
                                                        const std::string& forecast);

/// A quantity that is linear in functions of the parameters, at n instants: q(p) = lift + coefficientsᵀ w(p).
struct LinearQuantity {
  std::shared_ptr<const model::ParameterFunctions> functions;  ///< w: d → r
  Eigen::VectorXd lift;                                        ///< n
  Eigen::MatrixXd coefficients;                                ///< r × n
};

/// Any quantity of a forecast but the crack length. Errors: DataError for what the model lacks.
[[nodiscard]] LinearQuantity linear_quantity(const model::SeparatedModel& model,
                                             const ForecastSpecification& specification,
                                             std::span<const TimePosition> instants);

/// The elastic cracks at the measured dofs; DataError where the model lacks them.
[[nodiscard]] CrackMetaModel elastic_cracks(const model::SeparatedModel& model, const model::Dofs& seen,
                                            const std::string& forecast);
[[nodiscard]] CrackBridgeOptions bridge_options(const ForecastSpecification& specification);

}  // namespace knothe::assimilation
