#include "knothe/offline/similar_runs.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"
#include "knothe/offline/problem.hpp"

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

std::vector<model::Axis> axes_of(double lower, double upper) {
  return {parameter_axis("Y0", 216, lower, upper, 2), parameter_axis("Ad", 2.25e-3, lower, upper, 2),
          parameter_axis("E", 30e9, lower, upper, 2)};
}

/// The run that stands for a point.
std::vector<double> run_for(const Similarity& similarity, const std::vector<double>& point) {
  for (const std::vector<double>& run : similarity.points()) {
    const std::vector<double> a = similarity.invariants(run), b = similarity.invariants(point);
    if (std::ranges::equal(a, b, [](double x, double y) { return std::abs(x - y) < 1e-12; })) return run;
  }
  return {};
}

/// Largest difference of a run and the direct solution, as a fraction of the largest value. The run has twice
/// as many load steps, and the point twice its s: load steps coincide.
double difference(const BeamProblem& problem, const std::vector<model::Axis>& axes,
                  const Similarity& similarity, const std::vector<double>& point) {
  BeamProblem finer = problem;
  finer.solver.steps *= 2;
  const model::Snapshots run = BeamSimulator(finer, axes).solve(run_for(similarity, point));
  const model::Snapshots direct = BeamSimulator(problem, axes).solve(point);
  const auto [amplitude, modulus] = similarity.factors(point);
  EXPECT_NEAR(amplitude, 2, 1e-12);
  const auto of = [](double factor, const std::vector<double>& scaled, const std::vector<double>& expected) {
    double largest = 0, scale = 0;
    for (std::size_t i = 0; i < expected.size(); ++i) {
      largest = std::max(largest, std::abs(factor * scaled[i] - expected[i]));
      scale = std::max(scale, std::abs(expected[i]));
    }
    return largest / scale;
  };
  const std::vector<double>& force = direct.outputs[0].values;
  EXPECT_LT(force.back() / force.front(), 9.9);  // damaged: an elastic run would say nothing
  return std::max(of(amplitude, run.values, direct.values),
                  of(amplitude * modulus, run.outputs[0].values, force));
}

TEST(Similarity, IsExactForEveryLawAndRegularisation) {
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
    const Similarity similarity(problem, axes, 9);  // A_d Y₀ = 0.25, 0.354, …, 4
    for (const std::vector<double>& point : {std::vector{2.0, 0.5, 2.0}, std::vector{0.5, 1.0, 0.5}})
      EXPECT_LT(difference(problem, axes, similarity, point), 1e-8)
          << to_text(c.law) << ' ' << to_text(c.regularisation.kind);
  }
}

TEST(Similarity, SpringsKeepTheModulus) {
  BeamProblem problem = coarse_problem();
  problem.beam.support_stiffness = 1e8;
  std::vector<model::Axis> axes = axes_of(0.5, 2);
  const Similarity similarity(problem, axes, 9);
  EXPECT_EQ(similarity.nodes().size(), 2u);  // ln(A_d Y₀) and E
  EXPECT_LT(difference(problem, axes, similarity, {2.0, 0.5, 0.5}), 1e-8);
}

TEST(Similarity, FractureEnergyCountsTheOtherWay) {
  const std::vector<model::Axis> axes = {parameter_axis("Y0", 216, 0.5, 2, 3),
                                         parameter_axis("Gf", 80, 0.5, 2, 3)};
  const BeamProblem problem =
      coarse_problem(SofteningLaw::exponential, {DamageRegularisation::crack_band, 0.01, 0.01});
  const Similarity similarity(problem, axes, 5);
  EXPECT_EQ(similarity.exponents(), (std::vector{1.0, -1.0}));
  const std::vector<double> run = run_for(similarity, {2.0, 2.0});
  ASSERT_EQ(run.size(), 2u);
  EXPECT_NEAR(run[0], 0.5, 1e-12);
  EXPECT_NEAR(run[1], 0.5, 1e-12);
  EXPECT_LT(difference(problem, axes, similarity, {2.0, 2.0}), 1e-8);
}

/// A project of the coarse beam with these lines in [offline].
project::Project project_with(const std::string& lines, int nodes) {
  const auto axis = [&](const char* name, double reference) {
    return fmt::format("[offline.parameters.{}]\nreference = {}\nlower = 0.7\nupper = 1.3\nnodes = {}\n",
                       name, reference, nodes);
  };
  return project::parse_project(
      "[parameters]\nY0 = { prior = \"normal\", mean = 1, std = 0.2 }\n"
      "Ad = { prior = \"normal\", mean = 1, std = 0.2 }\n"
      "[offline]\nmesh = { element = 0.02 }\nsteps = 40\n" +
          lines + axis("Y0", 216) + axis("Ad", 2.25e-3),
      "beam.toml");
}

/// Root mean square over fields and points of û − u, û: splines through a filled grid, u: direct runs.
double error_off_the_grid(const project::Project& project, const model::GridSolutions& solutions) {
  const std::vector<model::Axis> axes = parameter_axes(project);
  const auto solver = project_simulator(project, axes);
  double sum = 0, count = 0;
  for (const std::vector<double>& point : points_in_box(axes, 6, 5)) {
    const model::Snapshots direct = solver->solve(point);
    const numerics::CubicSplineBasis first(axes[0].nodes), second(axes[1].nodes);
    const Eigen::VectorXd a = first.cardinal_weights(point[0]), b = second.cardinal_weights(point[1]);
    Eigen::MatrixXd field = Eigen::MatrixXd::Zero(solutions.dof_count(), std::ssize(direct.time));
    for (Index i = 0; i < a.size(); ++i)
      for (Index j = 0; j < b.size(); ++j) field += a[i] * b[j] * solutions.field(i * b.size() + j);
    field -= Eigen::Map<const Eigen::MatrixXd>(direct.values.data(), field.rows(), field.cols());
    sum += field.squaredNorm();
    count += field.size();
  }
  return std::sqrt(sum / count);
}

TEST(SimilarGrid, NineRunsAreBetterThanATensorGridOfFortyNine) {
  const files::TestFolder folder;
  const files::CommandOutput quiet(true);
  const project::Project tensor = project_with("", 7);
  const auto solver = project_simulator(tensor, parameter_axes(tensor));
  const SolvedGrid direct = solve_project_grid(tensor, *solver, folder.file("tensor"), quiet);
  const project::Project few = project_with("scaling = \"on\"\nscaling_runs = 9\nscaling_steps = 400\n", 25);
  const SolvedGrid similar = solve_similar_grid(few, folder.file("similar"), quiet);
  const double of_tensor = error_off_the_grid(tensor, direct.solutions);
  const double of_similar = error_off_the_grid(few, similar.solutions);
  EXPECT_LT(of_similar, 0.5 * of_tensor) << of_tensor;
  EXPECT_LT(similar.solutions.largest_left_out, 1e-9);
}

// An opening in place of the load, and E, which needs no run of its own.
TEST(SimilarGrid, TakesAnotherTimeAxisAndTheModulus) {
  const files::TestFolder folder;
  const project::Project project = project_with(
      "scaling = \"on\"\nscaling_runs = 7\nscaling_steps = 200\ntime = \"crack_mouth_opening\"\n"
      "time_values = [1e-5, 2e-5, 4e-5]\n[offline.parameters.E]\nreference = 30e9\nlower = 0.9\n"
      "upper = 1.1\nnodes = 3\n",
      5);
  const model::GridSolutions found =
      solve_similar_grid(project, folder.file("runs"), files::CommandOutput(true)).solutions;
  EXPECT_EQ(found.snapshots.time, (std::vector{1e-5, 2e-5, 4e-5}));
  const auto solver = project_simulator(project, parameter_axes(project));
  const std::size_t point = found.snapshots.grid_size() / 2 + 1;
  const std::vector<double> parameters = found.snapshots.parameters_at(point);
  const model::Snapshots direct = solver->solve(parameters);
  const Eigen::MatrixXd expected =
      Eigen::Map<const Eigen::MatrixXd>(direct.values.data(), found.dof_count(), 3);
  EXPECT_LT((found.field(point) - expected).cwiseAbs().maxCoeff(), 0.01 * expected.cwiseAbs().maxCoeff());
  const auto force = [](const model::Snapshots& solution) {
    return std::ranges::find(solution.outputs, "reaction_force", &model::SnapshotOutput::name)->values;
  };
  for (std::size_t t = 0; t < 3; ++t)
    EXPECT_NEAR(force(found.snapshots)[3 * point + t], force(direct)[t], 0.01 * force(direct)[t]);
}

}  // namespace
