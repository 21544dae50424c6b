#include "knothe/model/grid/sparse_grid.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "knothe/base/error.hpp"

namespace knothe::model {
namespace {

using Function = std::function<double(const std::vector<double>&)>;

Snapshots axes_only(const std::vector<std::size_t>& nodes) {
  Snapshots snapshots;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    Axis axis;
    axis.name = fmt::format("p{}", i);
    for (std::size_t n = 0; n < nodes[i]; ++n)
      axis.nodes.push_back(1.0 + static_cast<double>(n) / static_cast<double>(nodes[i] - 1));
    snapshots.axes.push_back(axis);
  }
  snapshots.time = {1.0};
  return snapshots;
}

/// Largest error at the points that are not computed, and how many are.
std::pair<double, std::size_t> error(const std::vector<std::size_t>& nodes, int level, const Function& f) {
  Snapshots snapshots = axes_only(nodes);
  const SparseGrid grid = sparse_grid(snapshots.axes, level);
  snapshots.values.assign(snapshots.grid_size(), -1e9);
  for (const std::size_t point : grid.points) snapshots.values[point] = f(snapshots.parameters_at(point));
  interpolate_others(grid, snapshots);
  double worst = 0;
  for (std::size_t i = 0; i < snapshots.values.size(); ++i)
    worst = std::max(worst, std::abs(snapshots.values[i] - f(snapshots.parameters_at(i))));
  return {worst, grid.points.size()};
}

TEST(SparseGrid, NodesComeMiddleFirstThenEndsThenGaps) {
  EXPECT_EQ(node_levels(1), (std::vector{0}));
  EXPECT_EQ(node_levels(2), (std::vector{0, 1}));
  EXPECT_EQ(node_levels(3), (std::vector{1, 0, 1}));
  EXPECT_EQ(node_levels(4), (std::vector{1, 0, 2, 1}));
  EXPECT_EQ(node_levels(5), (std::vector{1, 2, 0, 2, 1}));
  EXPECT_EQ(node_levels(9), (std::vector{1, 3, 2, 3, 0, 3, 2, 3, 1}));
}

TEST(SparseGrid, CountsOfFiveParameters) {
  // 1 + 2 · 5, + 4 · C(5, 2), …: Σ over the number of axes that are not in the middle.
  const Snapshots snapshots = axes_only({3, 3, 3, 3, 3});
  EXPECT_EQ(sparse_grid(snapshots.axes, 1).points.size(), 11u);
  EXPECT_EQ(sparse_grid(snapshots.axes, 2).points.size(), 51u);
  EXPECT_EQ(finest_level(snapshots.axes), 5);
  const SparseGrid all = sparse_grid(snapshots.axes, 5);
  EXPECT_EQ(all.points.size(), 243u);
  EXPECT_TRUE(all.others.empty());
}

TEST(SparseGrid, SumsOfFunctionsOfFewParametersAreExact) {
  // Three nodes hold parabolas, five cubics; level 3 has all products of two axes of three nodes, or one
  // cubic.
  const Function pairs = [](const std::vector<double>& p) {
    return 3 - p[0] * p[0] * p[1] * p[1] + p[2] * p[3] * p[3] - 2 * p[0] * p[3];
  };
  EXPECT_LT(error({3, 3, 3, 3}, 2, pairs).first, 1e-12);
  EXPECT_GT(error({3, 3, 3, 3}, 1, pairs).first, 1e-2);
  const Function cubic = [](const std::vector<double>& p) {
    return p[0] * p[0] * p[0] - 4 * p[1] * p[1] + p[2];
  };
  EXPECT_LT(error({5, 5, 3}, 2, cubic).first, 1e-12);
}

TEST(SparseGrid, SmoothFunctionsTakeFewPoints) {
  const Function smooth = [](const std::vector<double>& p) {
    return std::exp(0.4 * p[0] + 0.3 * p[1] - 0.2 * p[2]) / (1 + 0.3 * p[3] * p[0]);
  };
  double before = 1;
  std::size_t points = 0;
  for (const int level : {1, 2, 3, 4, 5}) {
    const auto [worst, count] = error({5, 5, 5, 5}, level, smooth);
    EXPECT_LT(worst, 0.5 * before) << level;
    EXPECT_GT(count, points);
    before = worst;
    points = count;
  }
  EXPECT_LT(before, 1e-4);
  EXPECT_LT(points, 500u);  // of 625
}

TEST(SparseGrid, ANegativeLevelIsRefused) {
  try {
    (void)sparse_grid(axes_only({3}).axes, -1);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_STREQ(error.what(), "sparse grid: level is -1; it must not be negative");
  }
}

}  // namespace
}  // namespace knothe::model
