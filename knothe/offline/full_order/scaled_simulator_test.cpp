#include "knothe/offline/full_order/scaled_simulator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace {

using namespace knothe;
using namespace knothe::offline;

BeamProblem coarse_problem(SofteningLaw law = SofteningLaw::brittle,
                           DamageRegularisationOptions regularisation = {}) {
  BeamProblem problem;
  problem.beam.element = 0.02;
  problem.beam.largest_element = 0.06;
  problem.solver.steps = 10;
  problem.solver.displacement = 4e-4;
  problem.solver.regularisation = regularisation;
  problem.reference.law = law;
  return problem;
}

std::vector<model::Axis> axes_of(double lower, double upper, int nodes = 2) {
  return {parameter_axis("Y0", 216, lower, upper, nodes), parameter_axis("Ad", 2.25e-3, lower, upper, nodes),
          parameter_axis("E", 30e9, lower, upper, 2)};
}

/// Largest difference of two solutions' fields and outputs, as a fraction of the largest value of each.
double difference(const model::Snapshots& a, const model::Snapshots& b) {
  const auto of = [](const std::vector<double>& x, const std::vector<double>& y) {
    double largest = 0, scale = 0;
    for (std::size_t i = 0; i < x.size(); ++i)
      largest = std::max(largest, std::abs(x[i] - y[i])), scale = std::max(scale, std::abs(y[i]));
    return largest / scale;
  };
  EXPECT_EQ(a.time, b.time);
  EXPECT_EQ(a.values.size(), b.values.size());
  double worst = of(a.values, b.values);
  for (std::size_t k = 0; k < a.outputs.size(); ++k) {
    EXPECT_EQ(a.outputs[k].name, b.outputs[k].name);
    if (a.outputs[k].name != "equilibrium_residual")
      worst = std::max(worst, of(a.outputs[k].values, b.outputs[k].values));
  }
  return worst;
}

// With s twice that of the point that is solved, and twice as many steps there, the load steps coincide.
TEST(ScaledSimulator, IsTheDirectRunForEveryLawAndRegularisation) {
  using R = DamageRegularisation;
  struct Case {
    SofteningLaw law;
    DamageRegularisationOptions regularisation;
  };
  for (const Case& c :
       {Case{SofteningLaw::brittle, {}}, Case{SofteningLaw::brittle, {R::crack_band, 0.01, 0.01}},
        Case{SofteningLaw::exponential, {R::crack_band, 0.01, 0.01}},
        Case{SofteningLaw::bilinear, {R::crack_band, 0.01, 0.01}},
        Case{SofteningLaw::brittle, {R::gradient, 0.01, 0.045}}}) {
    const BeamProblem problem = coarse_problem(c.law, c.regularisation);
    const std::vector<model::Axis> axes = axes_of(0.5, 2);
    ScaledSimulator scaled(problem, axes, 2);
    BeamSimulator direct(problem, axes);
    for (const std::vector<double>& point : {std::vector{2.0, 0.5, 2.0}, std::vector{0.5, 1.0, 0.5}}) {
      const std::vector<double> solved = scaled.reference_of(point);
      EXPECT_NE(solved, point);
      EXPECT_NEAR(solved[0] * solved[1], point[0] * point[1], 1e-10);
      const model::Snapshots found = scaled.solve(point), expected = direct.solve(point);
      EXPECT_LT(difference(found, expected), 1e-8) << to_text(c.law) << ' ' << to_text(c.regularisation.kind);
      // The load reaches the damage: an elastic run would say nothing.
      const auto& force = expected.outputs[0].values;
      EXPECT_LT(force.back() / force.front(), 9.9) << to_text(c.regularisation.kind);
    }
  }
}

// Where load steps do not coincide, what is between them is linear.
TEST(ScaledSimulator, ComesCloserWithMoreSteps) {
  const std::vector<model::Axis> axes = axes_of(0.5, 2);
  const std::vector<double> point = {1.3, 0.8, 1.1};
  const BeamProblem problem = coarse_problem();
  const model::Snapshots exact = BeamSimulator(problem, axes).solve(point);
  const auto error = [&](int substeps) {
    return difference(ScaledSimulator(problem, axes, substeps).solve(point), exact);
  };
  const double coarse = error(2);
  EXPECT_LT(error(16), 0.2 * coarse);
  EXPECT_LT(error(64), 0.02 * coarse);
}

TEST(ScaledSimulator, SpringsKeepTheModulus) {
  BeamProblem problem = coarse_problem();
  problem.beam.support_stiffness = 1e8;
  const std::vector<model::Axis> axes = axes_of(0.5, 2);
  ScaledSimulator scaled(problem, axes, 2);
  const std::vector<double> point = {2.0, 0.5, 0.5};
  EXPECT_EQ(scaled.reference_of(point), (std::vector{0.5, 2.0, 0.5}));
  EXPECT_LT(difference(scaled.solve(point), BeamSimulator(problem, axes).solve(point)), 1e-8);
}

TEST(ScaledSimulator, GridOfCommonRatioNeedsAsManyRunsAsProducts) {
  std::vector<model::Axis> axes = {parameter_axis("Y0", 216, 0.5, 1.5, 7),
                                   parameter_axis("Ad", 2.25e-3, 0.5, 1.5, 7)};
  space_by_ratio(axes);
  EXPECT_DOUBLE_EQ(axes[0].nodes.front(), 0.5);
  EXPECT_DOUBLE_EQ(axes[0].nodes.back(), 1.5);
  EXPECT_NEAR(axes[0].nodes[3], std::sqrt(0.75), 1e-15);
  const ScaledSimulator scaled(coarse_problem(), axes, 2);
  std::set<std::vector<double>> solved;
  for (const double y0 : axes[0].nodes)
    for (const double ad : axes[1].nodes) {
      solved.insert(scaled.reference_of(std::vector{y0, ad}));
      // Of the box, and never one whose load steps end before those of the point.
      EXPECT_LE((*solved.begin())[0], 1.5);
      EXPECT_LE(scaled.reference_of(std::vector{y0, ad})[0], y0 * (1 + 1e-10));
    }
  EXPECT_EQ(solved.size(), 13u);
}

TEST(ScaledSimulator, FractureEnergyCountsTheOtherWay) {
  std::vector<model::Axis> axes = {parameter_axis("Y0", 216, 0.5, 2, 3), parameter_axis("Gf", 80, 0.5, 2, 3)};
  const BeamProblem problem =
      coarse_problem(SofteningLaw::exponential, {DamageRegularisation::crack_band, 0.01, 0.01});
  ScaledSimulator scaled(problem, axes, 2);
  const std::vector<double> point = {2.0, 2.0};
  EXPECT_EQ(scaled.reference_of(point), (std::vector{0.5, 0.5}));
  EXPECT_LT(difference(scaled.solve(point), BeamSimulator(problem, axes).solve(point)), 1e-8);
}

TEST(ScaledSimulator, FilesAreThoseOfTheSolutions) {
  const files::TestFolder folder;
  std::vector<model::Axis> axes = {parameter_axis("Y0", 216, 0.5, 2, 3),
                                   parameter_axis("Ad", 2.25e-3, 0.5, 2, 3)};
  space_by_ratio(axes);
  ScaledSimulator scaled(coarse_problem(), axes, 2);
  model::RunGrid grid;
  grid.axes = axes;
  grid.parts_folder = folder.file("parts");
  grid.quiet = true;
  const model::GridRuns runs = model::run_grid(scaled, grid);
  ASSERT_EQ(runs.snapshots.grid_size(), 9u);
  const model::Snapshots one = scaled.solve(runs.snapshots.parameters_at(5));
  const auto values = runs.snapshots.solution(5);
  EXPECT_TRUE(std::equal(values.begin(), values.end(), one.values.begin(), one.values.end()));
  EXPECT_EQ(runs.snapshots.lift, one.lift);
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.file("parts")))
    files += entry.is_regular_file();
  EXPECT_EQ(files, 9u);  // those that were solved are gone
  for (const model::RunSummary& run : model::run_grid(scaled, grid).runs) EXPECT_TRUE(run.resumed);
}

TEST(ScaledSimulator, OtherRatiosAreToldWithTheRemedy) {
  std::vector<model::Axis> axes = {parameter_axis("Y0", 216, 0.5, 1.5, 7),
                                   parameter_axis("Ad", 2.25e-3, 0.5, 1.5, 9)};
  EXPECT_EQ(files::message_of<ProjectError>([&] { space_by_ratio(axes); }),
            "[offline] scaling = \"on\": runs serve several points where the nodes of Y0 and Ad have the "
            "same ratio, "
            "(upper / lower)^(1 / (nodes - 1)); it is 1.201 for Y0 and 1.147 for Ad: choose their numbers of "
            "nodes, or "
            "their ends, so that it is the same");
}

}  // namespace
