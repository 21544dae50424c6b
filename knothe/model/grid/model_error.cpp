#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/model/compress/compression.hpp"
#include "knothe/model/reduced/deviation.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::model {

using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd coefficients_of(const ModelContents& contents, const VectorXd& w) {
  const Index l = contents.space_modes, r = contents.parameter_modes, times = std::ssize(contents.time);
  MatrixXd coefficients(l, times);
  if (contents.form == Form::tree)
    coefficients.reshaped() = Eigen::Map<const RowMatrix>(contents.temporal.data(), times * l, r) * w;
  else
    coefficients = w.asDiagonal() * Eigen::Map<const RowMatrix>(contents.temporal.data(), l, times);
  return coefficients;
}

MatrixXd field_of(const ModelContents& contents, const VectorXd& w) {
  MatrixXd field = lift_of(contents);
  field.noalias() += space_of(contents) * coefficients_of(contents, w);
  return field;
}

VectorXd functions_at_node(const ModelContents& contents, std::size_t index) {
  const Index r = contents.parameter_modes;
  if (contents.form == Form::tree) {
    const Eigen::Map<const RowMatrix> joint(contents.joint.data(), r, std::ssize(contents.joint) / r);
    return joint.col(index);
  }
  VectorXd w = VectorXd::Ones(r);
  for (std::size_t i = contents.axes.size(); i-- > 0;) {
    const std::size_t n = contents.axes[i].nodes.size();
    const Eigen::Map<const RowMatrix> alpha(contents.parameters[i].data(), r, n);
    w.array() *= alpha.col(index % n).array();
    index /= n;
  }
  return w;
}

MatrixXd field_at(const SeparatedModel& model, std::span<const double> p) {
  FunctionBatch w;
  w.resize(1, model.functions()->dimension(), model.functions()->count(), 0);
  const MatrixXd point = Eigen::Map<const Eigen::RowVectorXd>(p.data(), std::ssize(p));
  model.functions()->evaluate(point, 0, w);
  return field_of(model.contents(), w.value.row(0).transpose());
}

namespace {

/// Squared norms of one solution, its deviation from the lift and its error; with and without time weights.
struct Sums {
  double solution = 0.0, deviation = 0.0, error = 0.0;
  double plain_solution = 0.0, plain_error = 0.0;
  double max = 0.0;
};

/// Of the model's `field`, n_dof × n_t, from the solution.
Sums compare(const ModelContents& contents, const MatrixXd& field, std::span<const double> solution,
             const VectorXd& time_weights) {
  const auto lift = lift_of(contents);
  if (std::ssize(solution) != lift.size()) {
    throw UsageError("the solutions and the model differ in number of dofs or time steps");
  }
  const Eigen::Map<const MatrixXd> u(solution.data(), lift.rows(), lift.cols());
  const MatrixXd error = u - field;
  const auto norms = [](const auto& matrix) -> VectorXd {
    return matrix.colwise().squaredNorm().transpose();
  };
  const VectorXd of_solution = norms(u), of_error = norms(error);
  return {time_weights.dot(of_solution),
          time_weights.dot(norms(u - lift)),
          time_weights.dot(of_error),
          of_solution.sum(),
          of_error.sum(),
          error.cwiseAbs().maxCoeff()};
}

/// √(part / whole); where there is nothing to compare with, any error counts as 100 %.
double ratio(double part, double whole) {
  if (whole > 0.0) return std::sqrt(part / whole);
  return part > 0.0 ? 1.0 : 0.0;
}

ModelError total(std::span<const Sums> sums, const VectorXd& weights) {
  Sums all;
  for (Index i = 0; i < std::ssize(sums); ++i) {
    const double weight = weights[i];
    all.solution += weight * sums[i].solution;
    all.deviation += weight * sums[i].deviation;
    all.error += weight * sums[i].error;
    all.plain_solution += sums[i].plain_solution;
    all.plain_error += sums[i].plain_error;
    all.max = std::max(all.max, sums[i].max);
  }
  return {ratio(all.error, all.solution), ratio(all.error, all.deviation), all.max,
          ratio(all.plain_error, all.plain_solution)};
}

}  // namespace

ModelError training_error(const ModelContents& contents, const Snapshots& snapshots, std::size_t threads) {
  if (contents.grid_shape() != snapshots.grid_shape())
    throw UsageError("the model and the snapshots have different grids");
  const Deviation deviation(snapshots);
  std::vector<Sums> sums(snapshots.grid_size());
  parallel_for(sums.size(), threads, [&](std::size_t g) {
    sums[g] = compare(contents, field_of(contents, functions_at_node(contents, g)), snapshots.solution(g),
                      deviation.time_weights());
  });
  return total(sums, deviation.grid_weights());
}

ModelError off_grid_error(const ModelContents& contents, std::span<const OffGridSolution> solutions) {
  return off_grid_error(contents, solutions.size(), [&](std::size_t i) { return solutions[i]; });
}

ModelError off_grid_error(const ModelContents& contents, std::size_t count,
                          const std::function<OffGridSolution(std::size_t)>& solution, std::size_t threads) {
  const SeparatedModel model(contents);
  const VectorXd time_weights = trapezoid_weights(contents.time);
  std::vector<Sums> sums(count);
  parallel_for(count, threads, [&](std::size_t i) {
    const OffGridSolution at = solution(i);
    sums[i] = compare(contents, field_at(model, at.parameters), at.values, time_weights);
  });
  const auto n = std::ssize(sums);
  return total(sums, VectorXd::Constant(n, 1.0 / n));
}

}  // namespace knothe::model
