#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/reduction/compress/compression.hpp"
#include "knothe/reduction/model/deviation.hpp"
#include "knothe/reduction/model/model_matrices.hpp"
#include "knothe/reduction/model/separated_model.hpp"

namespace knothe::reduction {

Eigen::MatrixXd field_at(const SeparatedModel& model, std::span<const double> p) {
  const ModelContents& contents = model.contents();
  FunctionBatch w;
  w.resize(1, model.functions()->dimension(), model.functions()->count(), 0);
  const Eigen::MatrixXd point =
      Eigen::Map<const Eigen::RowVectorXd>(p.data(), static_cast<Eigen::Index>(p.size()));
  model.functions()->evaluate(point, 0, w);
  Eigen::MatrixXd coefficients(static_cast<Eigen::Index>(contents.space_modes),
                               static_cast<Eigen::Index>(contents.time.size()));
  for (Eigen::Index t = 0; t < coefficients.cols(); ++t) {
    coefficients.col(t).noalias() =
        core_of(contents, static_cast<std::size_t>(t)) * w.value.row(0).transpose();
  }
  Eigen::MatrixXd field = lift_of(contents);
  field.noalias() += space_of(contents) * coefficients;
  return field;
}

namespace {

/// Squared norms of one solution, its deviation from the lift and its error; with and without time weights.
struct Sums {
  double solution = 0.0, deviation = 0.0, error = 0.0;
  double plain_solution = 0.0, plain_error = 0.0;
  double max = 0.0;
};

Sums compare(const SeparatedModel& model, std::span<const double> p, std::span<const double> solution,
             const Eigen::VectorXd& time_weights) {
  const auto lift = lift_of(model.contents());
  if (static_cast<Eigen::Index>(solution.size()) != lift.size()) {
    throw UsageError("the solutions and the model differ in number of dofs or time steps");
  }
  const Eigen::Map<const Eigen::MatrixXd> u(solution.data(), lift.rows(), lift.cols());
  const Eigen::MatrixXd error = u - field_at(model, p);
  const auto norms = [](const auto& matrix) -> Eigen::VectorXd {
    return matrix.colwise().squaredNorm().transpose();
  };
  const Eigen::VectorXd of_solution = norms(u), of_error = norms(error);
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

ModelError total(std::span<const Sums> sums, const Eigen::VectorXd& weights) {
  Sums all;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const double weight = weights[static_cast<Eigen::Index>(i)];
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
  const SeparatedModel model(contents);
  const Deviation deviation(snapshots);
  std::vector<Sums> sums(snapshots.grid_size());
  parallel_for(sums.size(), threads, [&](std::size_t g) {
    sums[g] = compare(model, snapshots.parameters_at(g), snapshots.solution(g), deviation.time_weights());
  });
  return total(sums, deviation.grid_weights());
}

ModelError off_grid_error(const ModelContents& contents, std::span<const OffGridSolution> solutions) {
  const SeparatedModel model(contents);
  const Eigen::VectorXd time_weights = trapezoid_weights(contents.time);
  std::vector<Sums> sums;
  for (const OffGridSolution& solution : solutions) {
    sums.push_back(compare(model, solution.parameters, solution.values, time_weights));
  }
  const auto n = static_cast<Eigen::Index>(sums.size());
  return total(sums, Eigen::VectorXd::Constant(n, 1.0 / static_cast<double>(n)));
}

}  // namespace knothe::reduction
