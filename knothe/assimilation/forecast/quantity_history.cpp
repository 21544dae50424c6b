#include "knothe/assimilation/forecast/quantity_history.hpp"

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

}  // namespace

QuantityHistory::QuantityHistory(const SeparatedModel& model, const model::Dofs& seen,
                                 const ForecastSpecification& specification) {
  if (specification.quantity == ForecastSpecification::Quantity::crack_length) {
    cracks_ = crack_bridges(model, seen, specification);
    offset_ = specification.length_offset;
    linear_.functions = model.functions();
    return;
  }
  std::vector<TimePosition> times;
  for (std::size_t t = 0; t < model.contents().time.size(); ++t) times.push_back({t, t, 0});
  linear_ = linear_quantity(model, specification, times);
}

Eigen::MatrixXd QuantityHistory::values(const Eigen::Ref<const Eigen::MatrixXd>& points, std::size_t first,
                                        Index count) const {
  const model::ParameterFunctions& functions = *linear_.functions;
  model::FunctionBatch at;
  at.resize(points.rows(), functions.dimension(), functions.count(), 0);
  functions.evaluate(points, 0, at);
  Eigen::MatrixXd values(points.rows(), count);
  if (cracks_.empty()) {
    const Index start = first;
    values = at.value * linear_.coefficients.middleCols(start, count);
    values.rowwise() += linear_.lift.segment(start, count).transpose();
  } else {
    for (Index k = 0; k < count; ++k) values.col(k) = lengths(cracks_[first + k], at.value);
  }
  return values;
}

/// Of the cracks that are meant.
Eigen::VectorXd QuantityHistory::lengths(const CrackBridge& crack, const model::RowMatrix& functions) const {
  const LengthCurve& curve = crack.options().curve;
  return crack.nearest(functions).length.unaryExpr([&](double elastic) { return curve(elastic) + offset_; });
}

}  // namespace knothe::assimilation
