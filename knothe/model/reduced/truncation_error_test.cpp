#include "knothe/model/reduced/truncation_error.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/grid/grid_refinement.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::model {
namespace {

using files::message_of;

/// A travelling front: no few modes represent it.
double front(std::size_t dof, double t, std::span<const double> p) {
  const Mesh mesh = small_mesh();
  const double x = mesh.points[3 * (dof / 3)] + 0.3 * mesh.points[3 * (dof / 3) + 1];
  return t * std::tanh(8 * (x - 0.15 * t * p[0]) * p[1]) * (1.0 + 0.1 * static_cast<double>(dof % 3));
}

Snapshots front_snapshots() {
  Snapshots snapshots = snapshots_of(front, two_axes(), {0.2, 0.5, 0.8, 1.0}, 36);
  snapshots.mesh = small_mesh();
  snapshots.dofs = dofs_on(*snapshots.mesh);
  return snapshots;
}

TEST(TruncationError, IsTheSecondMomentOfTheErrorsAtGridPointsAndOffThem) {
  const Snapshots snapshots = front_snapshots();
  CompressionOptions options;
  options.modes = 2;
  const SeparatedModel model(compress(snapshots, options));
  std::vector<OffGridSolution> off_grid;
  for (const double y0 : {0.6, 1.1}) {
    OffGridSolution solution{{y0, 0.9}, {}};
    for (const double t : snapshots.time)
      for (std::size_t dof = 0; dof < 36; ++dof)
        solution.values.push_back(front(dof, t, solution.parameters));
    off_grid.push_back(std::move(solution));
  }
  const std::vector<std::size_t> dofs = {1, 13, 30};
  std::vector<double> points;
  std::vector<std::int64_t> components;
  for (const std::size_t dof : dofs) {
    points.insert(points.end(), &snapshots.dofs.points[3 * dof], &snapshots.dofs.points[3 * dof] + 3);
    components.push_back(snapshots.dofs.components[dof]);
  }
  // All dofs as modes: nothing is left to the diagonal, and the moments are those of the errors, one by one.
  const TruncationError whole = truncation_error(model.contents(), snapshots, off_grid, 36);
  const std::vector<std::size_t> steps = {1, 3};
  const std::vector<double> times = {model.contents().time[1], model.contents().time[3]};
  const ObservedTruncation seen =
      observe_truncation(whole, model.contents(), "model", Sensors({points, components}), {}, times);
  const ObservedModel observed = observe_dofs(model, dofs);
  for (std::size_t s = 0; s < 2; ++s) {
    Eigen::Matrix3d expected = Eigen::Matrix3d::Zero();
    const auto add = [&](std::span<const double> p, std::span<const double> u, double weight) {
      const Eigen::Vector2d point(p[0], p[1]);
      Eigen::Vector3d e = -observed.predict(point, steps[s]);
      for (int i = 0; i < 3; ++i) e[i] += u[steps[s] * 36 + dofs[static_cast<std::size_t>(i)]];
      expected += weight * e * e.transpose();
    };
    for (std::size_t g = 0; g < snapshots.grid_size(); ++g)
      add(snapshots.parameters_at(g), snapshots.solution(g),
          1.0 / static_cast<double>(snapshots.grid_size()));
    for (const auto& solution : off_grid) add(solution.parameters, solution.values, 0.5);
    expected *= std::max(1.0, whole.persistence / 2);  // the steps are two apart
    Eigen::Matrix3d covariance = seen.factors[s] * seen.factors[s].transpose();
    covariance.diagonal() += seen.left_out.col(static_cast<Eigen::Index>(s));
    EXPECT_LT((covariance - expected).norm(), 1e-10 * expected.norm());
    EXPECT_GT(expected.norm(), 1e-6);
  }
  EXPECT_GT(whole.persistence, 1.0);  // the front's error goes on from step to step
  EXPECT_LT(whole.persistence, 7.0);
  // Fewer modes: the total variance over all dofs stays the same.
  const TruncationError few = truncation_error(model.contents(), snapshots, off_grid, 3);
  EXPECT_EQ(few.count, 3u);
  for (std::size_t t = 0; t < 4; ++t) {
    double total = 36 * few.variance[t], all = 36 * whole.variance[t];
    for (std::size_t k = 0; k < 3; ++k) total += few.covariance[9 * t + 4 * k];
    for (std::size_t k = 0; k < 36; ++k) all += whole.covariance[36 * 36 * t + 37 * k];
    EXPECT_NEAR(total, all, 1e-10 * all);
  }
}

TEST(TruncationError, GoesThroughTheModelFileAndIsMissedWhereItIsNot) {
  const files::TestFolder folder;
  const Snapshots snapshots = front_snapshots();
  CompressionOptions options;
  options.modes = 3;
  const ModelContents model = compress(snapshots, options);
  const TruncationError error = truncation_error(model, snapshots);
  const std::string path = folder.file("model.h5"), without = folder.file("without.h5");
  write_model(model, error, path);
  const TruncationError back = read_truncation_error(path);
  EXPECT_EQ(back.count, error.count);
  EXPECT_EQ(back.space, error.space);
  EXPECT_EQ(back.covariance, error.covariance);
  EXPECT_EQ(back.variance, error.variance);
  EXPECT_EQ(back.persistence, error.persistence);
  EXPECT_EQ(read_model(path).joint, model.joint);
  write_model(model, without);
  const std::string text = message_of<DataError>([&] {
    static_cast<void>(observe_truncation(read_truncation_error(without), model, without, {}, {}, {}));
  });
  EXPECT_NE(text.find("the model's file has no /truncation: make the model again"), std::string::npos)
      << text;
}

TEST(GridRefinement, FindsTheAxisAndIntervalWhereTheFunctionBends) {
  // Smooth in Ad, a kink in Y0 near 1.2.
  const auto kinked = [](std::size_t dof, double t, std::span<const double> p) {
    return t * (p[1] * p[1] + std::abs(p[0] - 1.17)) * static_cast<double>(dof + 1);
  };
  const Snapshots snapshots = snapshots_of(kinked, two_axes(), {0.5, 1.0}, 6);
  const auto weak = weakest_node(snapshots, {});
  ASSERT_TRUE(weak);
  EXPECT_EQ(weak->axis, 0u);
  EXPECT_EQ(snapshots.axes[0].nodes[weak->node], 1.2);
  const std::vector<double> expected = {0.5, 0.7, 0.9, 1.05, 1.2, 1.35, 1.5};
  const auto axes = refined(snapshots.axes, *weak);
  ASSERT_EQ(axes[0].nodes.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(axes[0].nodes[i], expected[i], 1e-15);
  EXPECT_EQ(axes[1].nodes, snapshots.axes[1].nodes);
}

}  // namespace
}  // namespace knothe::model
