#include "knothe/offline/latin/latin_separated.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/offline/latin/latin_model.hpp"
#include "knothe/offline/latin/latin_separation.hpp"

namespace knothe::offline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::HasSubstr;

/// The beam with elements of 10 mm.
BeamProblem coarse_beam(int steps, double displacement = 4e-4) {
  BeamProblem problem;
  problem.beam.element = 0.01;
  problem.solver.steps = steps;
  problem.solver.displacement = displacement;
  return problem;
}

struct Grid {
  std::vector<model::Axis> axes;
  std::vector<DamageParameters> parameters;
};

Grid grid_of(double half_width) {
  const std::vector<double> nodes = {1 - half_width, 1, 1 + half_width};
  Grid grid{{{"Y0", nodes, "1", "", 216.0}, {"Ad", nodes, "1", "", 2.25e-3}}, {}};
  for (const double y0 : nodes)
    for (const double ad : nodes) grid.parameters.push_back({216.0 * y0, 2.25e-3 * ad});
  return grid;
}

std::shared_ptr<const Structure> body_of(const BeamProblem& problem) {
  return std::make_shared<const Structure>(make_mesh(problem), problem.elastic, "beam");
}

/// Largest difference on any dof at the points, and ‖·‖ relative to u − u_lift.
struct Difference {
  double relative = 0, largest = 0;
};
Difference difference(const Structure& structure, const LatinSolution& a, const LatinSolution& b) {
  Difference result;
  double error = 0, size = 0;
  for (std::size_t t = 0; t < b.coordinates.size(); ++t)
    for (Index p = 0; p < b.coordinates[t].cols(); ++p) {
      const VectorXd e = a.displacement(structure, t, p) - b.displacement(structure, t, p);
      error += e.squaredNorm();
      size += (b.space * b.coordinates[t].col(p).tail(b.space.cols())).squaredNorm();
      result.largest = std::max(result.largest, e.cwiseAbs().maxCoeff());
    }
  result.relative = std::sqrt(error / size);
  return result;
}

TEST(LatinSeparated, WhereTheCrackBeginsItMeetsTheFullOrderSolution) {
  // 0.09 mm: the first elements soften, at all nine points.
  const BeamProblem problem = coarse_beam(12, 9e-5);
  const Grid grid = grid_of(0.2);
  SeparatedOptions options;
  options.accuracy = 3e-8;
  const auto structure = body_of(problem);
  const SeparatedSolution found =
      solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
  EXPECT_TRUE((found.solution.accepted.array() == 1).all());
  EXPECT_GT(found.terms.count(), 3);
  EXPECT_LE(found.history.back().correction, options.accuracy);
  FullOrderModel model(structure, problem.solver);
  for (const std::size_t p : {0U, 4U, 8U}) {
    const FullOrderResult run = model.run(grid.parameters[p]);
    const auto dofs = static_cast<std::size_t>(structure->dof_count());
    for (std::size_t step = 0; step < run.steps.size(); ++step) {
      const Eigen::Map<const VectorXd> u(&run.displacement[step * dofs], structure->dof_count());
      const VectorXd e = found.solution.displacement(*structure, step, static_cast<Index>(p)) - u;
      EXPECT_LT(e.cwiseAbs().maxCoeff(), 2e-7) << p << ", step " << step;
      EXPECT_NEAR(found.solution.reaction(static_cast<Index>(p), static_cast<Index>(step)),
                  run.steps[step].reaction_force, 20)
          << p << ", step " << step;
    }
  }
}

TEST(LatinSeparated, MoreTermsAreMoreAccurateAndNeverBetterThanTheBestOfTheirNumber) {
  const BeamProblem problem = coarse_beam(14, 2.8e-4);
  const Grid grid = grid_of(0.5);
  const auto structure = body_of(problem);
  const LatinSolution joint = solve_latin_pgd(structure, problem.solver, grid.parameters, {});
  double before = 1;
  for (const double accuracy : {4e-6, 1e-6}) {
    SeparatedOptions options;
    options.accuracy = accuracy;
    const SeparatedSolution found =
        solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
    EXPECT_TRUE((found.solution.accepted.array() == 1).all());
    const Difference iterated = difference(*structure, found.solution, joint);
    EXPECT_LT(iterated.relative, before);
    before = iterated.relative;
    // The joint solution in as many terms, by alternating least squares: what separation costs at least.
    std::vector<MatrixXd> coordinates;
    for (const MatrixXd& c : joint.coordinates) coordinates.push_back(c.bottomRows(joint.space.cols()));
    LatinGrid numbers;
    for (const model::Axis& axis : grid.axes) {
      numbers.sizes.push_back(static_cast<Index>(axis.nodes.size()));
      numbers.weights.push_back(VectorXd::Constant(3, 1.0 / 3));
    }
    const LatinTerms best = separate(coordinates, numbers, found.terms.count(), 0);
    LatinSolution recompressed = joint;
    for (std::size_t t = 0; t < coordinates.size(); ++t)
      recompressed.coordinates[t].bottomRows(joint.space.cols()) = best.coordinates(static_cast<Index>(t));
    EXPECT_LT(difference(*structure, recompressed, joint).relative, iterated.relative);
  }
  EXPECT_LT(before, 1e-2);
}

TEST(LatinSeparated, WithFewTermsItSaysThatItIsNotAccurate) {
  const BeamProblem problem = coarse_beam(12);
  const Grid grid = grid_of(0.5);
  SeparatedOptions options;
  options.max_terms = 4;
  const SeparatedSolution found =
      solve_latin_separated(body_of(problem), problem.solver, grid.axes, grid.parameters, options);
  EXPECT_EQ(found.terms.count(), 4);
  EXPECT_TRUE((found.solution.accepted.array() == 0).all());
  EXPECT_GT(found.history.back().correction, options.accuracy);
}

LatinStart start_from(const LatinSolution& joint, double factor = 1) {
  LatinStart start{joint.space, {}};
  for (const MatrixXd& c : joint.coordinates)
    start.coordinates.emplace_back(factor * c.bottomRows(joint.space.cols()));
  return start;
}

TEST(LatinSeparated, StartedFromTheJointFormItNeedsFewStages) {
  const BeamProblem problem = coarse_beam(14, 2.8e-4);
  const Grid grid = grid_of(0.5);
  const auto structure = body_of(problem);
  const LatinSolution joint = solve_latin_pgd(structure, problem.solver, grid.parameters, {});
  SeparatedOptions options;
  const SeparatedSolution elastic =
      solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
  options.start = start_from(joint);
  const SeparatedSolution hybrid =
      solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
  EXPECT_TRUE((hybrid.solution.accepted.array() == 1).all());
  EXPECT_LT(hybrid.history.size(), elastic.history.size() / 4);
  EXPECT_LT(difference(*structure, hybrid.solution, joint).relative,
            difference(*structure, elastic.solution, joint).relative);
}

TEST(LatinSeparated, MoreTermsThanThereIsToGainDoNoHarm) {
  // Where the modes hold a new direction but for 1e-7, the rest must not be scaled up: the equations of the
  // updates would be so ill-conditioned that the iteration runs away.
  const BeamProblem problem = coarse_beam(8, 8e-5);
  Grid grid{{{"Y0", {0.5, 0.75, 1, 1.25, 1.5}, "1", "", 216.0}}, {}};
  grid.axes.push_back({"Ad", grid.axes[0].nodes, "1", "", 2.25e-3});
  for (const double y0 : grid.axes[0].nodes)
    for (const double ad : grid.axes[1].nodes) grid.parameters.push_back({216.0 * y0, 2.25e-3 * ad});
  SeparatedOptions options;
  options.accuracy = 1e-8;
  const SeparatedSolution found =
      solve_latin_separated(body_of(problem), problem.solver, grid.axes, grid.parameters, options);
  EXPECT_GT(found.terms.count(), 8);
  double best = 1;
  for (const SeparatedIteration& it : found.history) {
    if (it.round == 0) best = 1;  // steps came, or cells: there is more to balance
    EXPECT_LT(it.energy_error, 3 * std::max(best, 1e-6)) << it.round << ", terms " << it.terms;
    best = std::min(best, it.energy_error);
  }
  EXPECT_LT(best, 1e-2);
}

TEST(LatinSeparated, AnIterateThatIsNotFiniteIsNotHandedOver) {
  const BeamProblem problem = coarse_beam(6, 1.2e-4);
  const Grid grid = grid_of(0.2);
  const auto structure = body_of(problem);
  const LatinSolution joint = solve_latin_pgd(structure, problem.solver, grid.parameters, {});
  SeparatedOptions options;
  options.start = start_from(joint, 1e150);  // its squares are numbers, times Young's modulus they are not
  try {
    (void)solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
    ADD_FAILURE() << "it was handed over";
  } catch (const NumericalError& error) {
    EXPECT_THAT(error.what(), HasSubstr("the iterate is no longer finite (steps 0 to 5, stage 1, "));
    EXPECT_THAT(error.what(), HasSubstr("take the joint form: leave [offline.latin] separation away"));
  }
}

TEST(LatinSeparated, DoesNotDependOnTheThreads) {
  const BeamProblem problem = coarse_beam(10);
  const Grid grid = grid_of(0.5);
  const auto structure = body_of(problem);
  SeparatedOptions options;
  options.accuracy = 3e-6;
  options.threads = 1;
  const SeparatedSolution one =
      solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
  options.threads = 3;
  const SeparatedSolution three =
      solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
  EXPECT_GT(one.terms.count(), 3);
  EXPECT_TRUE(one.terms.time == three.terms.time);
  EXPECT_TRUE(one.solution.coordinates == three.solution.coordinates);
}

TEST(LatinSeparated, WhileNothingIsDamagedThereIsNoTerm) {
  const BeamProblem problem = coarse_beam(4, 1e-5);
  const Grid grid = grid_of(0.2);
  const auto structure = body_of(problem);
  const SeparatedSolution found =
      solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, {});
  EXPECT_EQ(found.terms.count(), 0);
  EXPECT_TRUE((found.solution.accepted.array() == 1).all());
  EXPECT_NEAR(found.solution.reaction(0, 3), 2 * structure->unit_reaction() * 1e-5,
              1e-9 * structure->unit_reaction() * 1e-5);
}

TEST(LatinSeparated, TheCanonicalModelIsTheTerms) {
  const BeamProblem problem = coarse_beam(10, 2e-4);
  const Grid grid = grid_of(0.2);
  SeparatedOptions accuracy;
  accuracy.accuracy = 3e-6;
  const LatinModel model = solve_separated_grid(problem, grid.axes, accuracy);
  ASSERT_TRUE(model.grid.terms.has_value());
  model::CompressionOptions options;
  options.form = model::Form::canonical;
  options.modes = 60;
  const model::ModelContents contents = model::compress(model.grid, options);
  EXPECT_EQ(contents.space_modes, static_cast<std::size_t>(model.grid.terms->time.cols()));
  EXPECT_LT(contents.relative_error, 1e-12);
  options.modes = 2;
  const model::ModelContents short_one = model::compress(model.grid, options);
  EXPECT_EQ(short_one.space_modes, 2U);
  EXPECT_GT(short_one.relative_error, 1e-6);
}

TEST(LatinSeparated, InterruptedItSaysThatNothingIsKept) {
  const BeamProblem problem = coarse_beam(10);
  const Grid grid = grid_of(0.2);
  request_cancellation();
  try {
    (void)solve_latin_separated(body_of(problem), problem.solver, grid.axes, grid.parameters, {});
    ADD_FAILURE() << "it went on";
  } catch (const Interrupted& error) {
    EXPECT_THAT(error.what(), HasSubstr("nothing is kept"));
  }
  request_cancellation(false);
}

TEST(LatinSeparated, ThatWasInterruptedGoesOnAsIfItHadNeverStopped) {
  const BeamProblem problem = coarse_beam(12, 2e-4);
  const Grid grid = grid_of(0.2);
  const auto structure = body_of(problem);
  SeparatedOptions options;
  options.accuracy = 3e-6;
  const SeparatedSolution whole =
      solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
  options.key = "this run";
  const files::TestFolder folder;  // two clones may be tested at once
  options.state_file = folder.file("interrupted.h5");
  for (const int stop : {4, 8}) {
    options.on_range = [&](int done) { request_cancellation(done == stop); };
    std::string message = "it went on";
    try {
      (void)solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
    } catch (const Interrupted& error) {
      message = error.what();
    }
    request_cancellation(false);
    EXPECT_THAT(message,
                HasSubstr("of 12; " + std::to_string(stop) + " steps are kept in " + options.state_file));
  }
  std::vector<int> ranges;
  options.on_range = [&](int done) { ranges.push_back(done); };
  const SeparatedSolution resumed =
      solve_latin_separated(structure, problem.solver, grid.axes, grid.parameters, options);
  EXPECT_THAT(ranges, testing::ElementsAre(8, 10));
  EXPECT_FALSE(std::filesystem::exists(options.state_file));
  EXPECT_GT(whole.terms.count(), 3);
  EXPECT_TRUE(whole.terms.time == resumed.terms.time);
  EXPECT_TRUE(whole.solution.coordinates == resumed.solution.coordinates);
  EXPECT_TRUE(whole.solution.residual == resumed.solution.residual);
  EXPECT_EQ(whole.solution.local_points, resumed.solution.local_points);
  EXPECT_EQ(whole.history.size(), resumed.history.size());
}

template <typename Change>
std::string refusal(Change change) {
  SeparatedOptions options;
  change(options);
  try {
    options.validate();
  } catch (const ProjectError& error) {
    return error.what();
  }
  return "nothing was refused";
}

TEST(LatinSeparated, OptionsThatMakeNoSenseAreNamed) {
  EXPECT_THAT(refusal([](SeparatedOptions& o) { o.accuracy = -1; }),
              HasSubstr("accuracy is -1 m; it must be positive"));
  EXPECT_THAT(refusal([](SeparatedOptions& o) { o.window = 0; }), HasSubstr("window is 0 steps"));
  EXPECT_THAT(refusal([](SeparatedOptions& o) { o.max_terms = 0; }),
              HasSubstr("max_terms, rounds and sweeps are 0"));
  EXPECT_THAT(refusal([](SeparatedOptions& o) { o.relaxation = 1.5; }), HasSubstr("relaxation is 1.5"));
  EXPECT_THAT(refusal([](SeparatedOptions& o) { o.stagnation = 1; }), HasSubstr("stagnation is 1"));
  EXPECT_THAT(refusal([](SeparatedOptions& o) { o.recompression = 2; }), HasSubstr("recompression is 2"));
  EXPECT_THAT(refusal([](SeparatedOptions& o) { o.activation = 0; }), HasSubstr("activation is 0"));
  const BeamProblem problem = coarse_beam(2);
  Grid grid = grid_of(0.2);
  grid.parameters.pop_back();
  try {
    (void)solve_latin_separated(body_of(problem), problem.solver, grid.axes, grid.parameters, {});
    ADD_FAILURE() << "eight points for nine nodes";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), HasSubstr("the axes have 9 grid points, and 8 parameter points are given"));
  }
  EXPECT_THAT([&] { (void)solve_latin_separated(body_of(problem), problem.solver, {}, {}, {}); },
              testing::ThrowsMessage<UsageError>(HasSubstr("no parameter point is given")));
  BeamProblem gradient = problem;
  gradient.solver.regularisation.kind = DamageRegularisation::gradient;
  grid = grid_of(0.2);
  EXPECT_THAT(
      [&] { (void)solve_latin_separated(body_of(problem), gradient.solver, grid.axes, grid.parameters, {}); },
      testing::ThrowsMessage<ProjectError>(HasSubstr("LATIN-PGD cannot do gradient damage")));
}

}  // namespace
}  // namespace knothe::offline
