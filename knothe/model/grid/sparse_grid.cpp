#include "knothe/model/grid/sparse_grid.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {
namespace {

/// One axis: levels, and for each level the nodes up to it with the weights of all nodes in them.
struct AxisLevels {
  std::vector<int> level;                                 ///< of each node
  std::vector<std::vector<std::size_t>> nodes;            ///< [level]
  std::vector<std::vector<std::vector<double>>> weights;  ///< [level][any node][node of the level]

  explicit AxisLevels(const Axis& axis) : level(node_levels(axis.nodes.size())) {
    const int finest = *std::max_element(level.begin(), level.end());
    for (int l = 0; l <= finest; ++l) {
      std::vector<double> places;
      nodes.emplace_back();
      for (Index n = 0; n < std::ssize(level); ++n)
        if (level[n] <= l) {
          nodes.back().push_back(n);
          places.push_back(axis.nodes[n]);
        }
      weights.emplace_back();
      for (const double x : axis.nodes) {
        if (places.size() < 2) {
          weights.back().push_back({1.0});
          continue;
        }
        const Eigen::VectorXd w = numerics::CubicSplineBasis(places).cardinal_weights(x);
        weights.back().emplace_back(w.begin(), w.end());
      }
    }
  }

  [[nodiscard]] int finest() const { return nodes.size() - 1; }
};

/// Calls visit(index) for all multi-indices below `sizes`, the last one fastest.
template <class Visit>
void for_each_index(const std::vector<std::size_t>& sizes, const Visit& visit) {
  std::vector<std::size_t> index(sizes.size(), 0);
  while (true) {
    visit(index);
    std::size_t axis = sizes.size();
    while (axis > 0 && ++index[axis - 1] == sizes[axis - 1]) index[--axis] = 0;
    if (axis == 0) return;
  }
}

int sum(const std::vector<std::size_t>& index) {
  return std::accumulate(index.begin(), index.end(), std::size_t{0});
}

/// Σ (−1)^|z| over z ∈ {0, 1}^d for which l + z still is in the set: the sign and count of a small tensor
/// grid.
int combination_coefficient(const std::vector<std::size_t>& levels, const std::vector<AxisLevels>& axes,
                            int level) {
  int result = 0;
  for_each_index(std::vector<std::size_t>(levels.size(), 2), [&](const std::vector<std::size_t>& z) {
    for (Index i = 0; i < std::ssize(z); ++i)
      if (static_cast<int>(levels[i] + z[i]) > axes[i].finest()) return;
    if (sum(levels) + sum(z) <= level) result += sum(z) % 2 == 0 ? 1 : -1;
  });
  return result;
}

std::size_t flat(const std::vector<std::size_t>& index, const std::vector<std::size_t>& sizes) {
  std::size_t result = 0;
  for (Index i = 0; i < std::ssize(sizes); ++i) result = result * sizes[i] + index[i];
  return result;
}

}  // namespace

std::vector<int> node_levels(std::size_t nodes) {
  std::vector<int> level(nodes, -1);
  if (nodes == 0) return level;
  level[(nodes - 1) / 2] = 0;
  int next = 1;
  for (const std::size_t end : {std::size_t{0}, nodes - 1})
    if (level[end] < 0) level[end] = next;
  while (std::find(level.begin(), level.end(), -1) != level.end()) {
    ++next;
    std::size_t last = 0;
    for (std::size_t n = 1; n < nodes; ++n) {
      if (level[n] < 0 || level[n] == next) continue;
      if (n - last > 1) level[(last + n) / 2] = next;
      last = n;
    }
  }
  return level;
}

int finest_level(std::span<const Axis> axes) {
  int result = 0;
  for (const Axis& axis : axes) {
    const std::vector<int> levels = node_levels(axis.nodes.size());
    result += *std::max_element(levels.begin(), levels.end());
  }
  return result;
}

SparseGrid sparse_grid(std::span<const Axis> axes, int level) {
  if (level < 0) throw UsageError(fmt::format("sparse grid: level is {}; it must not be negative", level));
  std::vector<AxisLevels> one;
  std::vector<std::size_t> sizes, level_counts;
  for (const Axis& axis : axes) {
    one.emplace_back(axis);
    sizes.push_back(axis.nodes.size());
    level_counts.push_back(one.back().nodes.size());
  }
  SparseGrid grid;
  std::vector<std::vector<std::size_t>> others;
  const std::size_t count = std::accumulate(sizes.begin(), sizes.end(), std::size_t{1}, std::multiplies<>());
  std::vector<std::size_t> place(count, 0);  // of a computed point among the computed ones
  for_each_index(sizes, [&](const std::vector<std::size_t>& index) {
    int levels = 0;
    for (Index i = 0; i < std::ssize(index); ++i) levels += one[i].level[index[i]];
    if (levels <= level) {
      place[flat(index, sizes)] = grid.points.size();
      grid.points.push_back(flat(index, sizes));
    } else {
      grid.others.push_back(flat(index, sizes));
      others.push_back(index);
    }
  });
  grid.weights.assign(grid.others.size() * grid.points.size(), 0.0);
  for_each_index(level_counts, [&](const std::vector<std::size_t>& levels) {
    if (sum(levels) > level) return;
    const int coefficient = combination_coefficient(levels, one, level);
    if (coefficient == 0) return;
    std::vector<std::size_t> small(levels.size());
    for (Index i = 0; i < std::ssize(levels); ++i) small[i] = one[i].nodes[levels[i]].size();
    for_each_index(small, [&](const std::vector<std::size_t>& at) {
      std::vector<std::size_t> point(at.size());
      for (Index i = 0; i < std::ssize(at); ++i) point[i] = one[i].nodes[levels[i]][at[i]];
      const std::size_t column = place[flat(point, sizes)];
      for (Index row = 0; row < std::ssize(others); ++row) {
        double weight = coefficient;
        for (Index i = 0; i < std::ssize(at); ++i) weight *= one[i].weights[levels[i]][others[row][i]][at[i]];
        grid.weights[row * grid.points.size() + column] += weight;
      }
    });
  });
  return grid;
}

void interpolate_others(const SparseGrid& grid, Snapshots& snapshots) {
  const auto interpolate = [&](std::vector<double>& values) {
    const std::size_t size = values.size() / (grid.points.size() + grid.others.size());
    for (Index row = 0; row < std::ssize(grid.others); ++row) {
      double* out = &values[grid.others[row] * size];
      std::fill_n(out, size, 0.0);
      for (Index column = 0; column < std::ssize(grid.points); ++column) {
        const double weight = grid.weights[row * grid.points.size() + column];
        if (weight == 0) continue;
        const double* in = &values[grid.points[column] * size];
        for (std::size_t k = 0; k < size; ++k) out[k] += weight * in[k];
      }
    }
  };
  interpolate(snapshots.values);
  for (SnapshotOutput& output : snapshots.outputs) interpolate(output.values);
}

}  // namespace knothe::model
