#include "knothe/assimilation/forecast/forecast_inputs.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/model/observe/observation_operator.hpp"

namespace knothe::assimilation {

using model::SeparatedModel;

LinearPrediction at_step(const model::ObservedModel& model, std::size_t step) {
  return {model.lift.col(step), model.space * model.core[step]};
}

const model::SnapshotOutput& find_output(const SeparatedModel& model, const std::string& name,
                                         const std::string& forecast) {
  for (const model::SnapshotOutput& output : model.contents().outputs) {
    if (output.name == name) return output;
  }
  const std::vector<std::string> names = model.output_names();
  throw DataError(fmt::format("{}: forecast.{} needs the model's output \"{}\"{}; it has: {}", model.where(),
                              forecast, name, did_you_mean(name, names), fmt::join(names, ", ")));
}

std::vector<double> imposed_displacements(const SeparatedModel& model, const std::string& forecast) {
  const std::vector<double>& values = find_output(model, "imposed_displacement", forecast).values;
  return {values.begin(), values.begin() + std::ssize(model.contents().time)};
}

std::vector<std::vector<double>> axis_nodes(const SeparatedModel& model) {
  std::vector<std::vector<double>> nodes;
  for (const model::Axis& axis : model.contents().axes) nodes.push_back(axis.nodes);
  return nodes;
}

model::ObservedModel observe_point(const SeparatedModel& model, const ForecastSpecification& specification) {
  const std::int64_t component = specification.component;
  return model::observe(model, {{specification.point.begin(), specification.point.end()}, {component}});
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
