#include "knothe/model/grid/grid_refinement.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/index.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {
namespace {

/// Largest miss at `node` of axis `axis`, if the splines did without it.
double surplus_at(const Snapshots& snapshots, std::size_t axis, std::size_t node,
                  std::span<const std::size_t> dofs) {
  const std::vector<double>& all = snapshots.axes[axis].nodes;
  std::vector<double> others = all;
  others.erase(others.begin() + node);
  const Eigen::VectorXd weights = numerics::CubicSplineBasis(others).cardinal_weights(all[node]);
  std::size_t stride = 1;
  for (std::size_t i = axis + 1; i < snapshots.axes.size(); ++i) stride *= snapshots.axes[i].nodes.size();
  const std::size_t n_dof = snapshots.dof_count();
  double largest = 0;
  for (std::size_t point = 0; point < snapshots.grid_size(); ++point) {
    if (point / stride % all.size() != node) continue;
    const std::size_t first = point - node * stride;  // the line's node 0
    for (Index step = 0; step < std::ssize(snapshots.time); ++step)
      for (const std::size_t dof : dofs) {
        double miss = snapshots.solution(point)[step * n_dof + dof];
        for (std::size_t k = 0; k < others.size(); ++k) {
          const std::size_t other = k < node ? k : k + 1;
          miss -= weights[k] * snapshots.solution(first + other * stride)[step * n_dof + dof];
        }
        largest = std::max(largest, std::abs(miss));
      }
  }
  return largest;
}

}  // namespace

std::optional<WeakNode> weakest_node(const Snapshots& snapshots, std::span<const std::size_t> dofs) {
  std::vector<std::size_t> all(snapshots.dof_count());
  std::iota(all.begin(), all.end(), std::size_t{0});
  std::optional<WeakNode> worst;
  for (std::size_t axis = 0; axis < snapshots.axes.size(); ++axis)
    for (std::size_t node = 1; node + 1 < snapshots.axes[axis].nodes.size(); ++node) {
      const double surplus =
          surplus_at(snapshots, axis, node, dofs.empty() ? std::span<const std::size_t>(all) : dofs);
      if (!worst || surplus > worst->surplus) worst = WeakNode{axis, node, surplus};
    }
  return worst;
}

std::vector<Axis> refined(std::vector<Axis> axes, const WeakNode& weak) {
  std::vector<double>& nodes = axes[weak.axis].nodes;
  const auto at = nodes.begin() + weak.node;
  const double before = 0.5 * (at[-1] + at[0]), after = 0.5 * (at[0] + at[1]);
  nodes.insert(nodes.insert(at, before) + 2, after);
  return axes;
}

}  // namespace knothe::model
