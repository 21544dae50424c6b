#include "knothe/model/grid/sparse_solutions.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::model {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

/// A polynomial of degrees (3, 2) with the mixed term p₀² p₁, at `dofs` dofs and two times.
double field(const VectorXd& p, double time, std::size_t dof) {
  const auto x = static_cast<double>(dof);
  return std::sin(0.1 * x) + time * (p[0] * p[0] * p[0] + std::cos(0.2 * x) * p[0] * p[0] * p[1]) +
         0.01 * p[1] * p[1];
}

Snapshots solution_at(const VectorXd& p, std::size_t dofs) {
  Snapshots solution;
  solution.time = {1, 2};
  for (const double time : solution.time)
    for (std::size_t dof = 0; dof < dofs; ++dof) solution.values.push_back(field(p, time, dof));
  solution.outputs = {{"sum", {"N", ""}, {p[0] + p[1], 2 * p[0] * p[1]}}};
  solution.axes = {{"a", {p[0]}, "1", ""}, {"b", {p[1]}, "1", ""}};
  return solution;
}

struct Problem {
  numerics::SparseInterpolation interpolation{VectorXd::Zero(2), VectorXd::Constant(2, 2.0)};
  std::vector<Snapshots> solutions;
  Snapshots frame;

  explicit Problem(std::size_t dofs) {
    for (const auto& index :
         std::vector<numerics::MultiIndex>{{0, 0}, {1, 0}, {0, 1}, {2, 0}, {1, 1}, {0, 2}, {3, 0}, {2, 1}}) {
      interpolation.add(index);
      solutions.push_back(solution_at(interpolation.node(index), dofs));
    }
    frame.axes = {{"a", graded_nodes(0, 2, 5), "1", ""}, {"b", graded_nodes(0, 2, 3), "1", ""}};
    frame.time = {1, 2};
  }
};

TEST(SparseSolutions, FillTheGridExactlyWhereTheDegreesSuffice) {
  for (const std::size_t dofs : {4U, 350U}) {  // as they are, and in a basis
    const Problem problem(dofs);
    const GridSolutions all = interpolate_on_grid(problem.interpolation, problem.frame, problem.solutions);
    EXPECT_EQ(all.basis.size() > 0, dofs > 300);
    ASSERT_EQ(all.snapshots.grid_size(), 15U);
    for (std::size_t g = 0; g < 15; ++g) {
      const std::vector<double> p = all.snapshots.parameters_at(g);
      const VectorXd point = Eigen::Map<const VectorXd>(p.data(), 2);
      const Eigen::MatrixXd found = all.field(g);
      for (Index t = 0; t < 2; ++t)
        for (std::size_t dof = 0; dof < dofs; ++dof)
          EXPECT_NEAR(found(static_cast<Index>(dof), t), field(point, 1.0 + static_cast<double>(t), dof),
                      1e-6);
      EXPECT_NEAR(all.snapshots.outputs[0].values[2 * g], p[0] + p[1], 1e-13);
      EXPECT_NEAR(all.snapshots.outputs[0].values[2 * g + 1], 2 * p[0] * p[1], 1e-13);
    }
  }
}

TEST(SparseSolutions, AxesGetTheFewestNodesThatFollowTheirPolynomials) {
  numerics::SparseInterpolation interpolation(VectorXd::Zero(4), VectorXd::Ones(4));
  interpolation.add({0, 0, 0, 0});
  interpolation.add({0, 1, 0, 0});
  for (int k = 1; k <= 3; ++k) interpolation.add({0, 0, k, 0});
  for (int k = 1; k <= 8; ++k) interpolation.add({0, 0, 0, k});
  std::vector<Axis> axes;
  for (const char* name : {"a", "b", "c", "d"}) axes.push_back({name, {0, 1}, "1", ""});
  const VectorXd p = VectorXd::Constant(4, 0.3);
  choose_nodes(interpolation,
               {.error = [&](const auto& missed) { return missed(p).cwiseAbs().sum(); }, .allowed = 1e-10},
               axes);
  EXPECT_EQ(axes[0].nodes.size(), 2U);  // constant
  EXPECT_EQ(axes[1].nodes.size(), 2U);  // linear
  EXPECT_EQ(axes[2].nodes.size(), 4U);  // cubic
  EXPECT_GT(axes[3].nodes.size(), 9U);
  EXPECT_EQ(axes[3].nodes.front(), 0);
  EXPECT_EQ(axes[3].nodes.back(), 1);
}

TEST(SparseSolutions, OfDifferentShapesAreRefused) {
  Problem problem(4);
  problem.solutions[3].values.pop_back();
  try {
    (void)interpolate_on_grid(problem.interpolation, problem.frame, problem.solutions);
    FAIL();
  } catch (const DataError& error) {
    EXPECT_STREQ(error.what(), "run 4 has 7 values, the first one 8: all must have the same");
  }
}

}  // namespace
}  // namespace knothe::model
