#include "knothe/model/observe/scalar_observations.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/reduced/outputs.hpp"

namespace knothe::model {
namespace {

/// What an output is on the grid: lift (mean over the grid, n_t) + basis (n_t × k) · functions (k × grid).
struct SeparatedOutput {
  Eigen::VectorXd lift;
  Eigen::MatrixXd basis;
  RowMatrix functions;
};

SeparatedOutput separate(const SeparatedModel& model, const std::string& name) {
  const ModelContents& contents = model.contents();
  const std::vector<double>& history = output_of(model, name).values;
  const auto times = std::ssize(contents.time);
  const auto grid = std::ssize(history) / times;
  Eigen::MatrixXd values = Eigen::Map<const Eigen::MatrixXd>(history.data(), times, grid);
  SeparatedOutput result;
  result.lift = values.rowwise().mean();
  values.colwise() -= result.lift;
  const double energy = values.squaredNorm();
  if (energy <= 1e-24 * history.size() * result.lift.squaredNorm()) {  // the same for all parameters
    result.basis.resize(times, 0);
    result.functions.resize(0, grid);
    return result;
  }
  const DominantSpace space = dominant_space(values, 1e-14 * energy, 1, 1);
  const Index rank = space.rank_for(1e-14 * energy);
  result.basis = space.basis.leftCols(rank);
  result.functions = result.basis.transpose() * values;
  return result;
}

}  // namespace

ObservedModel with_scalars(const ObservedModel& observed, const SeparatedModel& model,
                           std::span<const ScalarObservation> sensors) {
  const Index n = observed.space.rows(), l = observed.space.cols(), r = observed.functions->count();
  const auto m = std::ssize(sensors);
  const auto times = std::ssize(observed.time);
  std::vector<std::pair<Index, SeparatedOutput>> outputs;
  Index added = 0;
  ObservedModel result = observed;
  result.space.conservativeResize(n + m, l);
  result.space.bottomRows(m).setZero();
  result.lift.conservativeResize(n + m, times);
  for (Index i = 0; i < m; ++i) {
    const ScalarObservation& sensor = sensors[i];
    if (const auto dof = model.quantity(sensor.output)) {
      const Index row = *dof;
      result.space.row(n + i) = space_of(model.contents()).row(row);
      result.lift.row(n + i) = lift_of(model.contents()).row(row);
      continue;
    }
    if (!sensor.output.empty()) {
      outputs.emplace_back(i, separate(model, sensor.output));
      added += outputs.back().second.basis.cols();
      result.lift.row(n + i) = outputs.back().second.lift.transpose();
      continue;
    }
    const ObservedModel seen = observe(model, {sensor.points, sensor.components});
    const Eigen::Map<const Eigen::RowVectorXd> weights(sensor.coefficients.data(),
                                                       std::ssize(sensor.coefficients));
    result.space.row(n + i) = weights * seen.space;
    result.lift.row(n + i) = weights * seen.lift;
  }
  if (outputs.empty()) return result;
  // Each output is a space mode of its own: [U 0; 0 I], [C 0; 0 B_t], [w; φ].
  const auto count = std::ssize(outputs);
  result.space.conservativeResize(n + m, l + count);
  result.space.rightCols(count).setZero();
  for (auto& core : result.core) {
    core.conservativeResize(l + count, r + added);
    core.bottomRows(count).setZero();
    core.topRightCorner(l, added).setZero();
  }
  RowMatrix values = functions_on_grid(model.contents());
  values.conservativeResize(r + added, values.cols());
  Index at = r;
  for (Index k = 0; k < count; ++k) {
    const auto& [row, output] = outputs[k];
    const Index rank = output.basis.cols();
    // As large as the model's own functions: newtons beside metres would bury these where a covariance of
    // functions is truncated.
    const double own = values.topRows(r).norm(), size = output.functions.norm();
    const double scale = own > 0 && size > 0 ? own / size : 1;
    result.space(n + row, l + k) = 1;
    for (Index t = 0; t < times; ++t)
      result.core[t].row(l + k).segment(at, rank) = output.basis.row(t) / scale;
    values.middleRows(at, rank) = scale * output.functions;
    at += rank;
  }
  result.functions = std::make_shared<JointFunctions>(nodes_of(model.contents().axes),
                                                      std::span(values.data(), values.size()), r + added);
  return result;
}

}  // namespace knothe::model
