#include "knothe/model/observe/observed_model.hpp"

#include <fmt/format.h>

#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/observe/observation_operator.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/reduced/spline_functions.hpp"

namespace knothe::model {

namespace {

ObservedModel observe_by(const SeparatedModel& model, const ObservationOperator& operation) {
  ObservedModel observed;
  observed.functions = model.functions();
  observed.parameters = model.parameter_names();
  observed.time = model.contents().time;
  observed.space = operation.apply(space_of(model.contents()));
  observed.lift = operation.apply(lift_of(model.contents()));
  for (std::size_t step = 0; step < model.step_count(); ++step) {
    observed.core.push_back(core_of(model.contents(), step));
  }
  return observed;
}

ObservedModel observe_by(const Snapshots& snapshots, const ObservationOperator& operation) {
  const Index grid = snapshots.grid_size();
  const auto times = std::ssize(snapshots.time);
  const Index dofs = snapshots.dof_count();
  ObservedModel observed;
  observed.time = snapshots.time;
  std::vector<std::vector<double>> nodes;
  for (const Axis& axis : snapshots.axes) {
    observed.parameters.push_back(axis.name);
    nodes.push_back(axis.nodes);
  }
  // Cardinal functions: one at its own node of the grid, zero at the others.
  const RowMatrix identity = RowMatrix::Identity(grid, grid);
  observed.functions =
      std::make_shared<JointFunctions>(nodes, std::span(identity.data(), identity.size()), grid);
  observed.space = Eigen::MatrixXd::Identity(operation.rows(), operation.rows());
  // Cardinal splines sum to one, so what is subtracted from every node (here the grid's mean) comes back
  // exactly.
  observed.lift = Eigen::MatrixXd::Zero(operation.rows(), times);
  observed.core.assign(times, Eigen::MatrixXd(operation.rows(), grid));
  for (Index g = 0; g < grid; ++g) {
    const auto solution = snapshots.solution(g);
    const Eigen::MatrixXd seen =
        operation.apply(Eigen::Map<const Eigen::MatrixXd>(solution.data(), dofs, times));
    for (Index t = 0; t < times; ++t) observed.core[t].col(g) = seen.col(t);
  }
  for (Index t = 0; t < times; ++t) {
    Eigen::MatrixXd& core = observed.core[t];
    observed.lift.col(t) = core.rowwise().mean();
    core.colwise() -= observed.lift.col(t);
  }
  return observed;
}

}  // namespace

Eigen::VectorXd ObservedModel::predict(const Eigen::Ref<const Eigen::VectorXd>& p, std::size_t step) const {
  FunctionBatch w;
  w.resize(1, functions->dimension(), functions->count(), 0);
  functions->evaluate(p.transpose(), 0, w);
  const Eigen::VectorXd coefficients = core[step] * w.value.transpose();
  return lift.col(step) + space * coefficients;
}

ObservedModel observe(const SeparatedModel& model, const Dofs& places) {
  const ModelContents& contents = model.contents();
  return observe_by(model, ObservationOperator(contents.dofs, contents.mesh, model.where(), places));
}

ObservedModel observe_dofs(const SeparatedModel& model, std::span<const std::size_t> dofs) {
  for (const std::size_t dof : dofs) {
    if (dof < model.dof_count()) continue;
    throw UsageError(
        fmt::format("there is no dof {}: the model has dofs 0 to {}", dof, model.dof_count() - 1));
  }
  return observe_by(model, ObservationOperator(dofs));
}

ObservedModel observe_snapshots(const Snapshots& snapshots, const Dofs& places) {
  return observe_by(snapshots, ObservationOperator(snapshots.dofs, snapshots.mesh, "snapshots", places));
}

ObservedModel observe_snapshots(const Snapshots& snapshots) {
  std::vector<std::size_t> all(snapshots.dof_count());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return observe_by(snapshots, ObservationOperator(all));
}

ObservedModel at_steps(const ObservedModel& model, std::span<const std::size_t> steps) {
  ObservedModel part{model.functions, model.parameters, {}, model.space, {}, {}};
  part.lift.resize(model.lift.rows(), std::ssize(steps));
  Index column = 0;
  for (const std::size_t step : steps) {
    if (step >= model.time.size()) {
      throw UsageError(
          fmt::format("there is no time step {}: the model has steps 0 to {}", step, model.time.size() - 1));
    }
    part.time.push_back(model.time[step]);
    part.core.push_back(model.core[step]);
    part.lift.col(column++) = model.lift.col(step);
  }
  return part;
}

}  // namespace knothe::model
