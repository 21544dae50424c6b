#include "knothe/model/reduced/deviation.hpp"

#include <algorithm>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"

namespace knothe::model {

Eigen::VectorXd trapezoid_weights(std::span<const double> nodes) {
  const auto n = std::ssize(nodes);
  Eigen::VectorXd weights = Eigen::VectorXd::Constant(n, n == 1 ? 1.0 : 0.0);
  for (Index i = 0; i + 1 < n; ++i) {
    const double half = 0.5 * (nodes[i + 1] - nodes[i]);
    weights[i] += half;
    weights[i + 1] += half;
  }
  return weights / weights.sum();
}

Deviation::Deviation(const Snapshots& snapshots) : snapshots_(snapshots) {
  grid_weights_ = Eigen::VectorXd::Ones(1);
  for (const Axis& axis : snapshots.axes) {
    const Eigen::VectorXd weights = trapezoid_weights(axis.nodes);
    const Eigen::MatrixXd outer =
        weights * grid_weights_.transpose();  // column-major: the new axis is contiguous
    grid_weights_ = outer.reshaped();
  }
  time_weights_ = trapezoid_weights(snapshots.time);
  const Index dofs = snapshots.dof_count();
  if (!snapshots.lift.empty()) {
    lift_ = Eigen::Map<const Eigen::MatrixXd>(snapshots.lift.data(), dofs, times());
    return;
  }
  lift_ = Eigen::MatrixXd::Zero(dofs, times());
  for (std::size_t g = 0; g < snapshots.grid_size(); ++g) {
    lift_ += Eigen::Map<const Eigen::MatrixXd>(snapshots.solution(g).data(), dofs, times());
  }
  lift_ /= grid();
}

RowMatrix Deviation::at_time(Index t, Index first, Index count) const {
  RowMatrix block(count, dofs());
  for (Index g = 0; g < count; ++g) {
    const double* solution = snapshots_.solution(first + g).data();
    block.row(g) =
        Eigen::Map<const Eigen::RowVectorXd>(solution + t * dofs(), dofs()) - lift_.col(t).transpose();
  }
  return block;
}

Eigen::MatrixXd Deviation::grid_gram(std::size_t threads) const {
  // A few instants at a time, which bounds the memory; summed in order, so that the number of threads does
  // not matter.
  constexpr Index k_together = 8;
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(grid(), grid());
  for (Index start = 0; start < times(); start += k_together) {
    std::vector<Eigen::MatrixXd> parts(std::min(k_together, times() - start));
    parallel_for(parts.size(), threads, [&](std::size_t i) {
      const Index t = start + i;
      const RowMatrix block = at_time(t);
      parts[i] = time_weights_[t] * (block * block.transpose());
    });
    for (const Eigen::MatrixXd& part : parts) gram += part;
  }
  return gram;
}

Eigen::MatrixXd Deviation::applied(const Eigen::MatrixXd& b, std::size_t threads) const {
  constexpr Index k_points = 64;  // fixed, so that results do not depend on the number of threads
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(grid(), b.cols());
  parallel_for((grid() + k_points - 1) / k_points, threads, [&](std::size_t i) {
    const Index first = i * k_points, n = std::min(k_points, grid() - first);
    for (Index t = 0; t < times(); ++t)
      result.middleRows(first, n).noalias() +=
          std::sqrt(time_weights_[t]) * (at_time(t, first, n) * b.middleRows(t * dofs(), dofs()));
  });
  return result;
}

Eigen::MatrixXd Deviation::projected(const Eigen::MatrixXd& v, std::size_t threads) const {
  Eigen::MatrixXd result(dofs(), times() * v.cols());
  parallel_for(times(), threads, [&](std::size_t step) {
    const Index t = step;
    result.middleCols(t * v.cols(), v.cols()).noalias() =
        std::sqrt(time_weights_[t]) * (at_time(t).transpose() * v);
  });
  return result;
}

}  // namespace knothe::model
