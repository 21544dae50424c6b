#include "knothe/assimilation/forecast/forecast_inputs.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/model/observe/observation_operator.hpp"
#include "knothe/model/reduced/loading.hpp"
#include "knothe/model/reduced/outputs.hpp"

namespace knothe::assimilation {

using model::SeparatedModel;

namespace {

const model::SnapshotOutput& find_output(const SeparatedModel& model, const std::string& name,
                                         const std::string& forecast) {
  for (const model::SnapshotOutput& output : model.contents().outputs) {
    if (output.name == name) return output;
  }
  const std::vector<std::string> names = model.output_names();
  throw DataError(fmt::format("{}: forecast.{} needs the model's output \"{}\"{}; it has: {}", model.where(),
                              forecast, name, did_you_mean(name, names), fmt::join(names, ", ")));
}

/// A combination of displacements.
LinearQuantity of_displacements(const SeparatedModel& model, const model::Dofs& dofs,
                                const Eigen::VectorXd& weights, std::span<const TimePosition> instants) {
  const model::ObservedModel observed = model::observe(model, dofs);
  LinearQuantity quantity{model.functions(), Eigen::VectorXd(std::ssize(instants)),
                          Eigen::MatrixXd(model.functions()->count(), std::ssize(instants))};
  for (Index k = 0; k < std::ssize(instants); ++k) {
    const LinearPrediction u =
        interpolate(instants[k], at_step(observed, instants[k].lower), at_step(observed, instants[k].upper));
    quantity.lift[k] = weights.dot(u.lift);
    quantity.coefficients.col(k) = u.modes.transpose() * weights;
  }
  return quantity;
}

/// An output of the model, as functions of the parameters: one for each instant.
LinearQuantity output_of(const SeparatedModel& model, const ForecastSpecification& specification,
                         std::span<const TimePosition> instants) {
  const model::SnapshotOutput& output = find_output(model, specification.output, specification.name);
  const std::size_t times = model.contents().time.size();
  std::vector<double> values;  // [instant, grid of the parameters]
  for (const TimePosition& instant : instants)
    for (std::size_t g = 0; g < output.values.size(); g += times)
      values.push_back(
          instant.interpolate(output.values[g + instant.lower], output.values[g + instant.upper]));
  const Index n = std::ssize(instants);
  return {std::make_shared<model::JointFunctions>(model::nodes_of(model.contents().axes), values, n),
          Eigen::VectorXd::Zero(n), Eigen::MatrixXd::Identity(n, n)};
}

}  // namespace

LinearPrediction at_step(const model::ObservedModel& model, std::size_t step) {
  return {model.lift.col(step), model.space * model.core[step]};
}

std::string forecast_units(const model::ModelContents& model, const ForecastSpecification& specification) {
  if (specification.quantity != ForecastSpecification::Quantity::output) return "m";
  return model::output_units(model, specification.output);
}

std::vector<double> imposed_displacements(const SeparatedModel& model, const std::string& forecast) {
  const std::vector<double>& values = find_output(model, "imposed_displacement", forecast).values;
  return {values.begin(), values.begin() + std::ssize(model.contents().time)};
}

LinearQuantity linear_quantity(const SeparatedModel& model, const ForecastSpecification& specification,
                               std::span<const TimePosition> instants) {
  using Quantity = ForecastSpecification::Quantity;
  if (specification.quantity == Quantity::output) return output_of(model, specification, instants);
  const auto [x, y, z] = specification.point;
  return of_displacements(model, {{x, y, z}, {specification.component}}, Eigen::VectorXd::Ones(1), instants);
}

CrackMetaModel elastic_cracks(const SeparatedModel& model, const model::Dofs& seen,
                              const std::string& forecast) {
  const model::CrackSolutions& crack = model.contents().crack;
  if (crack.empty()) {
    throw DataError(
        fmt::format("{}: forecast.{} needs crack solutions, which this model lacks: build it with "
                    "`knothe offline` and offline.crack_lengths > 0",
                    model.where(), forecast));
  }
  const Index n_dof = model.dof_count();
  const auto n_modes = std::ssize(crack.modes) / n_dof;
  const auto n_lengths = std::ssize(crack.length);
  const model::ObservationOperator observation(model.contents().dofs, model.contents().mesh, model.where(),
                                               seen);
  const Eigen::MatrixXd observed_modes =
      observation.apply(Eigen::Map<const Eigen::MatrixXd>(crack.modes.data(), n_dof, n_modes));
  const Eigen::MatrixXd solutions =
      Eigen::Map<const model::RowMatrix>(crack.coefficients.data(), n_lengths, n_modes) *
      observed_modes.transpose();
  return {crack.length, solutions};
}

CrackBridgeOptions bridge_options(const ForecastSpecification& specification) {
  CrackBridgeOptions options;
  options.prior_mean = specification.prior_mean;
  options.prior_std = specification.prior_std;
  options.error_std = specification.model_error_std;
  options.curve = LengthCurve(specification.length_curve);
  options.threshold =
      specification.threshold.value_or(specification.prior_mean) - specification.length_offset;
  return options;
}

}  // namespace knothe::assimilation
