#include "knothe/assimilation/forecast/quantity_history.hpp"

#include "knothe/assimilation/forecast/forecast_inputs.hpp"
#include "knothe/model/reduced/spline_functions.hpp"

namespace knothe::assimilation {
namespace {

using model::SeparatedModel;

std::vector<CrackBridge> crack_bridges(const SeparatedModel& model, const model::Dofs& seen,
                                       const ForecastSpecification& specification) {
  const CrackMetaModel elastic = elastic_cracks(model, seen, specification.name);
  const std::vector<double> imposed = imposed_displacements(model, specification.name);
  const CrackBridgeOptions options = bridge_options(specification);
  const model::ObservedModel observed = model::observe(model, seen);
  std::vector<CrackBridge> cracks;
  for (std::size_t t = 0; t < observed.time.size(); ++t)
    cracks.emplace_back(elastic, at_step(observed, t), imposed[t], options);
  return cracks;
}

/// An output at each time, as functions of the parameters.
std::shared_ptr<const model::ParameterFunctions> output_functions(const SeparatedModel& model,
                                                                  const model::SnapshotOutput& output) {
  const Index times = std::ssize(model.contents().time), points = std::ssize(output.values) / times;
  const model::RowMatrix by_time =
      Eigen::Map<const model::RowMatrix>(output.values.data(), points, times).transpose();
  return std::make_shared<model::JointFunctions>(
      axis_nodes(model), std::span(by_time.data(), static_cast<std::size_t>(by_time.size())), times);
}

}  // namespace

QuantityHistory::QuantityHistory(const SeparatedModel& model, const model::Dofs& seen,
                                 const ForecastSpecification& specification)
    : functions_(model.functions()) {
  using Quantity = ForecastSpecification::Quantity;
  if (specification.quantity == Quantity::crack_length) {
    cracks_ = crack_bridges(model, seen, specification);
    offset_ = specification.length_offset;
  } else if (specification.quantity == Quantity::output) {
    const model::SnapshotOutput& output = find_output(model, specification.output, specification.name);
    functions_ = output_functions(model, output);
    units_ = output.labels.units;
  } else {
    const model::ObservedModel point = observe_point(model, specification);
    lift_ = point.lift.row(0).transpose();
    coefficients_.resize(functions_->count(), std::ssize(point.core));
    for (Index t = 0; t < coefficients_.cols(); ++t)
      coefficients_.col(t) = (point.space.row(0) * point.core[t]).transpose();
  }
}

Eigen::MatrixXd QuantityHistory::values(const Eigen::Ref<const Eigen::MatrixXd>& points, std::size_t first,
                                        Index count) const {
  model::FunctionBatch at;
  at.resize(points.rows(), functions_->dimension(), functions_->count(), 0);
  functions_->evaluate(points, 0, at);
  const Index start = first;
  if (lift_.size() > 0) {
    Eigen::MatrixXd values = at.value * coefficients_.middleCols(start, count);
    values.rowwise() += lift_.segment(start, count).transpose();
    return values;
  }
  if (cracks_.empty()) return at.value.middleCols(start, count);
  Eigen::MatrixXd values(points.rows(), count);
  for (Index k = 0; k < count; ++k) values.col(k) = lengths(cracks_[first + k], at.value);
  return values;
}

/// Of the cracks that are meant.
Eigen::VectorXd QuantityHistory::lengths(const CrackBridge& crack, const model::RowMatrix& functions) const {
  const LengthCurve& curve = crack.options().curve;
  return crack.nearest(functions).length.unaryExpr([&](double elastic) { return curve(elastic) + offset_; });
}

}  // namespace knothe::assimilation
