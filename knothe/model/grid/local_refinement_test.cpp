#include "knothe/model/grid/local_refinement.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::model {
namespace {

using testing::HasSubstr;

constexpr std::size_t k_dofs = 40;

/// The front by formula: what a full-order model would compute.
Snapshots front(std::vector<Axis> axes) {
  Snapshots snapshots = snapshots_of(travelling_front(k_dofs), std::move(axes), uneven_steps(6), k_dofs);
  SnapshotOutput force{"force", {"N", "force"}, {}};
  for (std::size_t g = 0; g < snapshots.grid_size(); ++g)
    for (std::size_t t = 0; t < snapshots.time.size(); ++t)
      force.values.push_back(1e6 * snapshots.solution(g)[t * k_dofs + k_dofs / 2]);
  snapshots.outputs.push_back(force);
  return snapshots;
}

Snapshots front_at(std::span<const double> p) {
  std::vector<Axis> axes = two_axes();
  for (std::size_t a = 0; a < axes.size(); ++a) axes[a].nodes = {p[a]};
  return front(axes);
}

const Neighbourhood k_at{Eigen::Vector2d(1.04, 0.93), Eigen::Vector2d(0.012, 0.015).cwiseAbs2().asDiagonal()};
const std::vector<double> k_mean = {1.04, 0.93};

std::vector<double> beside(double first, double second) {
  return {k_at.mean[0] + first * k_at.std()[0], k_at.mean[1] + second * k_at.std()[1]};
}

/// The mean, a cross and corners: nine solutions.
std::vector<Snapshots> nine_solutions() {
  std::vector<Snapshots> solutions;
  for (const double a : {0.0, -1.5, 1.5})
    for (const double b : {0.0, -1.5, 1.5}) solutions.push_back(front_at(beside(a, b)));
  return solutions;
}

struct Base {
  ModelContents model;
  TruncationError error;
};

/// Of the grid of `two_axes`, whose splines miss the front between their nodes.
Base base_model(Form form) {
  CompressionOptions options;
  options.form = form;
  options.modes = form == Form::canonical ? 12 : 20;
  const Snapshots snapshots = front(two_axes());
  Base base{compress(snapshots, options), {}};
  std::vector<OffGridSolution> off_grid;
  for (const auto& p : {std::vector{0.61, 1.41}, std::vector{1.37, 0.66}, std::vector{0.83, 0.91}})
    off_grid.push_back({p, front_at(p).values, front_at(p).outputs});
  base.error = truncation_error(base.model, snapshots, off_grid);
  return base;
}

double error_at(const ModelContents& model, const std::vector<double>& p) {
  const Snapshots exact = front_at(p);
  const Eigen::Map<const Eigen::MatrixXd> u(exact.values.data(), k_dofs, 6);
  return (u - field_at(SeparatedModel(model), p)).norm();
}

class LocalRefinement : public testing::TestWithParam<Form> {};

TEST_P(LocalRefinement, MeetsTheFullOrderModelAroundThePosterior) {
  const Base base = base_model(GetParam());
  const RefinedModel fine = refined(base.model, base.error, nine_solutions(), k_at);
  EXPECT_EQ(fine.model.form, Form::tree);
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  double before = 0, after = 0;
  for (int i = 0; i < 50; ++i) {
    const std::vector<double> p = beside(normal(random), normal(random));
    before = std::max(before, error_at(base.model, p));
    after = std::max(after, error_at(fine.model, p));
  }
  EXPECT_LT(after, before / 50);
}

TEST_P(LocalRefinement, MeetsEachSolutionWhereverItIs) {
  const Base base = base_model(GetParam());
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  std::vector<std::vector<double>> places = {k_mean};
  std::vector<Snapshots> solutions = {front_at(k_mean)};
  for (int i = 0; i < 9; ++i) {
    places.push_back(beside(1.3 * normal(random), 1.3 * normal(random)));
    solutions.push_back(front_at(places.back()));
  }
  const RefinedModel fine = refined(base.model, base.error, solutions, k_at);
  for (const std::vector<double>& p : places)
    EXPECT_LT(error_at(fine.model, p), 2e-3 * error_at(base.model, k_mean)) << p[0] << " " << p[1];
}

TEST_P(LocalRefinement, TheOutputsAreRefinedToo) {
  const Base base = base_model(GetParam());
  const RefinedModel fine = refined(base.model, base.error, nine_solutions(), k_at);
  const std::vector<double> p = beside(0.7, -0.4);
  const std::vector<double> exact = front_at(p).outputs[0].values;
  const auto worst = [&](const ModelContents& model) {
    const std::vector<double> value = SeparatedModel(model).evaluate_output("force", p).value;
    double largest = 0;
    for (std::size_t t = 0; t < value.size(); ++t) largest = std::max(largest, std::abs(value[t] - exact[t]));
    return largest;
  };
  EXPECT_LT(worst(fine.model), worst(base.model) / 100);
}

/// Errors of the force at the base's off-grid solutions, in order: by evaluating the model there.
std::vector<double> errors_of_force(const ModelContents& model) {
  std::vector<double> errors;
  for (const auto& p : {std::vector{0.61, 1.41}, std::vector{1.37, 0.66}, std::vector{0.83, 0.91}}) {
    const std::vector<double> exact = front_at(p).outputs[0].values,
                              value = SeparatedModel(model).evaluate_output("force", p).value;
    for (std::size_t t = 0; t < exact.size(); ++t) errors.push_back(exact[t] - value[t]);
  }
  return errors;
}

TEST_P(LocalRefinement, TheErrorsOfTheOutputsAreKnownBeforeAndAfter) {
  const Base base = base_model(GetParam());
  const std::vector<double> before = errors_of_force(base.model);
  EXPECT_EQ(base.error.off_grid_outputs.at("force"), before);
  const files::TestFolder folder;
  write_model(base.model, base.error, folder.file("m.h5"));
  EXPECT_EQ(read_truncation_error(folder.file("m.h5")).off_grid_outputs, base.error.off_grid_outputs);

  // Among observations of which nothing else is known, and between two times of the model linear.
  Sensors sensors;
  sensors.scalars = {"other", "cell"};
  ScalarObservation cell;
  cell.name = "cell", cell.output = "force";
  const std::vector<double>& time = base.model.time;
  const double times[] = {time[2], 0.5 * (time[2] + time[3])};
  const ObservedErrors seen = observe_off_grid(base.error, base.model, "m", sensors, {&cell, 1}, times, 2);
  ASSERT_EQ(seen.count(), 3);
  for (Eigen::Index j = 0; j < 3; ++j) {
    const double* of_solution = &before[static_cast<std::size_t>(6 * j)];
    const double expected[] = {of_solution[2], 0.5 * (of_solution[2] + of_solution[3])};
    for (std::size_t t = 0; t < 2; ++t) {
      const Eigen::VectorXd e = seen.space * seen.coefficients[t].col(j);
      EXPECT_EQ(e[0], 0);
      EXPECT_NEAR(e[1], expected[t], 1e-12 * std::abs(expected[t]));
    }
  }

  const RefinedModel fine = refined(base.model, base.error, nine_solutions(), k_at);
  const std::vector<double> after = errors_of_force(fine.model),
                            &told = fine.error.off_grid_outputs.at("force");
  ASSERT_EQ(told.size(), 9 * 6 + after.size());  // the refinement's solutions first
  const double scale = *std::max_element(before.begin(), before.end());
  for (std::size_t i = 0; i < after.size(); ++i) EXPECT_NEAR(told[9 * 6 + i], after[i], 1e-3 * scale) << i;
  // Around the posterior little is left.
  for (std::size_t i = 0; i < 9 * 6; ++i) EXPECT_LT(std::abs(told[i]), 0.1 * scale) << i;
}

TEST_P(LocalRefinement, AwayFromItLittleChanges) {
  const Base base = base_model(GetParam());
  const RefinedModel fine = refined(base.model, base.error, nine_solutions(), k_at);
  const SeparatedModel before(base.model), after(fine.model);
  // Nodes of the base, and a cell three widths away.
  for (const auto& p :
       {std::vector{0.9, 1.0}, std::vector{1.2, 0.8}, std::vector{0.5, 0.5}, std::vector{0.57, 1.44}}) {
    const Eigen::MatrixXd u = field_at(before, p);
    EXPECT_LT((field_at(after, p) - u).norm(), 0.3 * error_at(base.model, k_mean)) << p[0] << " " << p[1];
  }
}

TEST_P(LocalRefinement, KnowsTheErrorThatIsLeft) {
  const Base base = base_model(GetParam());
  const RefinedModel fine = refined(base.model, base.error, nine_solutions(), k_at);
  const TruncationError& error = fine.error;
  ASSERT_EQ(error.off_grid_count(), 12u);
  EXPECT_EQ(error.off_grid_reach[0], k_at.std()[0]);
  EXPECT_EQ(error.off_grid_reach[9 * 2], 0);
  const auto norm = [&](std::size_t j) {
    const std::size_t size = error.count * error.variance.size();
    return Eigen::Map<const Eigen::VectorXd>(error.off_grid.data() + j * size,
                                             static_cast<Eigen::Index>(size))
        .norm();
  };
  // Together they say how large it is at points between them.
  double said = 0, is = 0;
  for (std::size_t j = 0; j < 9; ++j) said += norm(j) * norm(j) / 9;
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i)
    is += std::pow(error_at(fine.model, beside(normal(random), normal(random))), 2) / 200;
  EXPECT_LT(std::sqrt(said / is), 8);
  EXPECT_GT(std::sqrt(said / is), 0.125);
  // Far away it is the base's own error.
  EXPECT_NEAR(norm(9), error_at(base.model, {0.61, 1.41}), 0.02 * norm(9));
}

TEST_P(LocalRefinement, OneSolutionMeetsItsPoint) {
  const Base base = base_model(GetParam());
  const std::vector<Snapshots> one = {front_at(k_mean)};
  const RefinedModel fine = refined(base.model, base.error, one, k_at);
  EXPECT_LT(error_at(fine.model, k_mean), 1e-4 * error_at(base.model, k_mean));
  EXPECT_LT(error_at(fine.model, beside(1, 1)), 0.5 * error_at(base.model, beside(1, 1)));
}

INSTANTIATE_TEST_SUITE_P(Forms, LocalRefinement, testing::Values(Form::tree, Form::canonical));

TEST(LocalRefinementFile, RoundTrips) {
  const Base base = base_model(Form::tree);
  const RefinedModel fine = refined(base.model, base.error, nine_solutions(), k_at);
  const std::string path = testing::TempDir() + "refined.h5";
  write_model(fine.model, fine.error, path);
  const TruncationError read = read_truncation_error(path);
  EXPECT_EQ(read.off_grid_points, fine.error.off_grid_points);
  EXPECT_EQ(read.off_grid_reach, fine.error.off_grid_reach);
  EXPECT_EQ(read.parameters, (std::vector<std::string>{"Y0", "Ad"}));
  EXPECT_EQ(read_model(path).joint, fine.model.joint);
}

TEST(LocalRefinementErrors, ASolutionOfAnotherModelIsRefused) {
  const Base base = base_model(Form::tree);
  std::vector<Snapshots> solutions = {front_at(k_mean)};
  solutions[0].axes[1].name = "E";
  try {
    (void)refined(base.model, base.error, solutions, k_at);
    FAIL() << "no error";
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(), HasSubstr("its parameter 1 is E, the model's Ad; is it the same project's?"));
  }
}

TEST(ScatteredInterpolation, ItsLeaveOneOutIsThatOfInterpolatingTheOthers) {
  const Eigen::MatrixXd points{{0.1, 0.2}, {0.8, 0.3}, {0.4, 0.9}, {0.5, 0.5}}, zeros{{1.0, 1.0}};
  const Eigen::VectorXd values{{1.0, -2.0, 0.5, 3.0}};
  const InterpolationKernel kernel{Eigen::Vector2d(0.4, 0.6), Eigen::Vector2d::Constant(1e6), 1e-10};
  const ScatteredInterpolation all(points, zeros, kernel);
  const Eigen::VectorXd missed = all.leave_one_out() * values;
  for (Eigen::Index left_out = 0; left_out < 4; ++left_out) {
    std::vector<Eigen::Index> others;
    for (Eigen::Index i = 0; i < 4; ++i)
      if (i != left_out) others.push_back(i);
    const ScatteredInterpolation without(points(others, Eigen::all), zeros, kernel);
    const double predicted = without.functions(points.row(left_out)).row(0).dot(values(others));
    EXPECT_NEAR(missed[left_out], values[left_out] - predicted, 1e-8);
    EXPECT_NEAR(all.left_out_std()[left_out], without.missed_std(points.row(left_out))[0], 1e-7);
  }
}

/// Mean kriging variance over the candidates with these solutions, the model exact at the corners of the
/// cells.
double mean_variance(const Eigen::MatrixXd& known, const Eigen::MatrixXd& zeros,
                     const Eigen::MatrixXd& candidates, const InterpolationKernel& kernel) {
  return ScatteredInterpolation(known, zeros, kernel).missed_std(candidates).squaredNorm() /
         static_cast<double>(candidates.rows());
}

TEST(MostInformative, IsTheCandidateThatLowersTheMeanVarianceMost) {
  const std::vector<Axis> axes = two_axes();
  const double left[] = {axes[0].nodes[1], axes[1].nodes[1]}, right[] = {axes[0].nodes[2], axes[1].nodes[2]};
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> inside(0.02, 0.98);
  const auto in_cell = [&] {
    return Eigen::RowVector2d(left[0] + inside(random) * (right[0] - left[0]),
                              left[1] + inside(random) * (right[1] - left[1]));
  };
  Eigen::MatrixXd candidates(40, 2), known(2, 2);
  for (Eigen::Index i = 0; i < 40; ++i) candidates.row(i) = in_cell();
  for (Eigen::Index i = 0; i < 2; ++i) known.row(i) = in_cell();
  const Eigen::MatrixXd zeros{
      {left[0], left[1]}, {right[0], left[1]}, {left[0], right[1]}, {right[0], right[1]}};
  InterpolationKernel kernel = kernel_of_cell(axes, {in_cell(), Eigen::Matrix2d::Identity()});
  kernel.nugget = 1e-8;
  const Eigen::MatrixXd two = most_informative(axes, known, candidates, kernel, 2);
  ASSERT_EQ(two.rows(), 2);
  for (Eigen::Index step = 0; step < 2; ++step) {
    Eigen::MatrixXd with(known.rows() + 1, 2);
    double best = std::numeric_limits<double>::infinity();
    Eigen::RowVector2d best_candidate;
    for (const auto& candidate : candidates.rowwise()) {
      with << known, candidate;
      if (const double variance = mean_variance(with, zeros, candidates, kernel); variance < best)
        best = variance, best_candidate = candidate;
    }
    EXPECT_EQ(two.row(step), best_candidate) << step;
    with << known, two.row(step);
    known = with;
  }
}

TEST(MostInformative, NothingWhereEverythingIsKnown) {
  const std::vector<Axis> axes = two_axes();
  const Eigen::MatrixXd candidates{{axes[0].nodes[1], axes[1].nodes[1]}, {0.77, 0.93}};
  const Eigen::MatrixXd known = candidates.bottomRows(1);
  const InterpolationKernel kernel = kernel_of_cell(axes, {known.row(0), Eigen::Matrix2d::Identity()});
  EXPECT_EQ(most_informative(axes, known, candidates, kernel, 2).rows(), 0);
}

}  // namespace
}  // namespace knothe::model
