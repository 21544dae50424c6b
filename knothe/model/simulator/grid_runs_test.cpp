#include "knothe/model/simulator/grid_runs.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using testing::HasSubstr;

/// u = a + b t at two dofs and three times, one after the other; fails where it is told to.
class Formula final : public Simulator {
 public:
  std::vector<double> fails_at;  ///< values of b
  std::vector<double> stops_at;  ///< the same: ends without a word, before the last time
  int solved = 0;

  [[nodiscard]] std::string key(std::span<const double> p) const override {
    return "formula " + std::to_string(p[0]) + " " + std::to_string(p[1]);
  }
  [[nodiscard]] Snapshots solve(std::span<const double> p) override {
    ++solved;
    for (const double b : fails_at)
      if (p[1] == b) throw NumericalError("b is too much");
    Snapshots solution;
    solution.axes = {{"a", {p[0]}, "1", ""}, {"b", {p[1]}, "1", ""}};
    solution.time = {0, 1, 2};
    for (const double b : stops_at)
      if (p[1] == b) solution.time.pop_back();
    for (const double t : solution.time)
      for (const double factor : {1.0, 10.0}) solution.values.push_back(factor * (p[0] + p[1] * t));
    solution.quantities = {{"one", "m"}, {"ten", "m"}};
    solution.outputs = {{"sum", {"1", "a + b"}, std::vector<double>(solution.time.size(), p[0] + p[1])}};
    return solution;
  }
};

RunGrid grid_in(const std::string& folder) {
  RunGrid grid;
  grid.axes = {{"a", {1, 2}, "N", "force"}, {"b", {3, 4, 5}, "1", ""}};
  grid.parts_folder = folder;
  grid.quiet = true;
  return grid;
}

TEST(PointRuns, KeepTheirOrderAndOnlyNewOnesAreComputed) {
  const files::TestFolder folder;
  Formula formula;
  const RunGrid grid = grid_in(folder.file("parts"));
  (void)run_points(formula, grid, std::vector<std::vector<double>>{{1.5, 3.25}, {2, 4}});
  EXPECT_EQ(formula.solved, 2);
  const PointRuns found =
      run_points(formula, grid, std::vector<std::vector<double>>{{2, 4}, {1, 5}, {1.5, 3.25}});
  EXPECT_EQ(formula.solved, 3);
  EXPECT_EQ(found.computed, (std::vector<std::size_t>{1}));
  const std::vector<double> first = read_run(found.runs[0]).solution.values;
  EXPECT_EQ(first, (std::vector<double>{2, 20, 6, 60, 10, 100}));
  EXPECT_EQ(read_run(found.runs[2]).solution.parameters_at(0), (std::vector<double>{1.5, 3.25}));
  formula.fails_at = {4.5};
  EXPECT_THAT(
      message_of<NumericalError>([&] {
        (void)run_points(formula, grid, std::vector<std::vector<double>>{{2, 4}, {1, 4.5}});
      }),
      HasSubstr("full-order run 2 of 2 (a = 1, b = 4.5) failed: b is too much; 1 of 2 runs are kept"));
}

TEST(GridRuns, GatherTheSolutionsInTheGridsOrderWithTheirFrame) {
  const files::TestFolder folder;
  Formula formula;
  const GridRuns runs = run_grid(formula, grid_in(folder.file("parts")));
  EXPECT_EQ(formula.solved, 6);
  EXPECT_EQ(runs.snapshots.grid_shape(), (files::Shape{2, 3}));
  EXPECT_EQ(runs.snapshots.axes[0].units, "N");
  const auto solution = runs.snapshots.solution(4);  // a = 2, b = 4
  EXPECT_EQ(std::vector<double>(solution.begin(), solution.end()),
            (std::vector<double>{2, 20, 6, 60, 10, 100}));
  EXPECT_EQ(runs.snapshots.outputs[0].values[3 * 4 + 1], 6);
  EXPECT_EQ(runs.snapshots.quantities[1].name, "ten");
}

TEST(GridRuns, ThoseThatAreKeptAreNotRunAgain) {
  const files::TestFolder folder;
  Formula formula;
  const GridRuns first = run_grid(formula, grid_in(folder.file("parts")));
  const GridRuns again = run_grid(formula, grid_in(folder.file("parts")));
  EXPECT_EQ(formula.solved, 6);
  EXPECT_EQ(first.snapshots.values, again.snapshots.values);
  for (const RunSummary& run : again.runs) EXPECT_TRUE(run.resumed);
}

TEST(GridRuns, AreSharedByTheMembersOfAJob) {
  const files::TestFolder folder;
  Formula one, other;
  // One after the other: the first finds that those of the second are missing, which a job would wait for.
  EXPECT_THROW((void)run_grid(one, grid_in(folder.file("parts")), {0, 2, [] {}}), DataError);
  const GridRuns runs = run_grid(other, grid_in(folder.file("parts")), {0, 1, [] {}});
  EXPECT_EQ(one.solved, 3);
  EXPECT_EQ(other.solved, 3);
  EXPECT_EQ(runs.snapshots.grid_size(), 6u);
}

TEST(GridRuns, ASolutionThatEndsEarlyIsAFailureAndIsMadeAgain) {
  const files::TestFolder folder;
  Formula formula;
  formula.stops_at = {3};  // the first run is one of them: the others are not blamed
  RunGrid grid = grid_in(folder.file("parts"));
  const std::string said = message_of<NumericalError>([&] { (void)run_grid(formula, grid); });
  EXPECT_THAT(said, HasSubstr("2 of 6 full-order runs failed; 4 of 6 runs are kept in"));
  EXPECT_THAT(said, HasSubstr("\n  run 1 (a = 1, b = 3): it has 2 times, up to 1, others 3, up to 2"));
  EXPECT_THAT(said, HasSubstr("\n  run 4 (a = 2, b = 3): "));
  grid.leave_out_failed = true;
  const GridRuns rest = run_grid(formula, grid);
  EXPECT_EQ(rest.failed, 2u);
  EXPECT_EQ(rest.snapshots.axes[1].nodes, (std::vector<double>{4, 5}));
  formula.stops_at.clear();
  formula.solved = 0;
  EXPECT_EQ(run_grid(formula, grid).snapshots.grid_size(), 6u);
  EXPECT_EQ(formula.solved, 2);
}

TEST(GridRuns, ThoseThatFailAreListedAndTheOthersAreKept) {
  const files::TestFolder folder;
  Formula formula;
  formula.fails_at = {4};
  const auto run = [&] { (void)run_grid(formula, grid_in(folder.file("parts"))); };
  const std::string both = message_of<NumericalError>(run);
  EXPECT_THAT(both, HasSubstr("2 of 6 full-order runs failed; 4 of 6 runs are kept in"));
  EXPECT_THAT(both, HasSubstr("\n  run 2 (a = 1, b = 4): b is too much"));
  EXPECT_THAT(both, HasSubstr("\n  run 5 (a = 2, b = 4): b is too much"));
  EXPECT_EQ(both.find("more"), std::string::npos);
  formula.fails_at = {3, 4, 5};  // all
  const std::string all =
      message_of<NumericalError>([&] { (void)run_grid(formula, grid_in(folder.file("x"))); });
  EXPECT_EQ(std::count(all.begin(), all.end(), '\n'), 4);
  EXPECT_THAT(all, HasSubstr("\n  and 3 more in the same way"));
  formula.fails_at.clear();
  formula.solved = 0;
  run();
  EXPECT_EQ(formula.solved, 2);  // the two once more
}

TEST(GridRuns, ThoseThatFailAreLeftOutWithTheirNodesWhereThatIsAskedFor) {
  const files::TestFolder folder;
  Formula formula;
  formula.fails_at = {5};
  RunGrid grid = grid_in(folder.file("parts"));
  grid.leave_out_failed = true;
  const GridRuns runs = run_grid(formula, grid);
  EXPECT_EQ(runs.failed, 2u);
  EXPECT_EQ(runs.snapshots.axes[1].nodes, (std::vector<double>{3, 4}));
  EXPECT_EQ(runs.snapshots.axes[0].nodes, (std::vector<double>{1, 2}));
  const auto solution = runs.snapshots.solution(3);  // a = 2, b = 4
  EXPECT_EQ(std::vector<double>(solution.begin(), solution.end()),
            (std::vector<double>{2, 20, 6, 60, 10, 100}));
  ASSERT_EQ(runs.runs.size(), 4u);
  EXPECT_EQ(runs.runs[3].parameters, (std::vector<double>{2, 4}));
  // Once it is mended, the whole grid, and only those two are run again.
  formula.fails_at.clear();
  formula.solved = 0;
  EXPECT_EQ(run_grid(formula, grid).snapshots.grid_size(), 6u);
  EXPECT_EQ(formula.solved, 2);
  grid.sparse_level = 1;
  EXPECT_THAT(message_of<ProjectError>([&] { (void)run_grid(formula, grid); }),
              HasSubstr("a sparse grid needs all its runs"));
}

/// Stops at the first failure, as the beam does.
class Stopping final : public Simulator {
 public:
  Formula formula;
  [[nodiscard]] std::string key(std::span<const double> p) const override { return formula.key(p); }
  [[nodiscard]] Snapshots solve(std::span<const double> p) override { return formula.solve(p); }
  [[nodiscard]] std::vector<RunFailure> solve_to_files(
      std::span<const Run> runs, int processes, const std::function<void(std::size_t)>& finished) override {
    for (std::size_t i = 0; i < runs.size(); ++i) {
      std::vector<RunFailure> failed = Simulator::solve_to_files(runs.subspan(i, 1), processes, finished);
      if (!failed.empty()) return {{i, failed[0].status, failed[0].message}};
    }
    return {};
  }
};

TEST(PointRuns, ASolverThatStopsAtAFailureIsAskedForTheOthers) {
  const files::TestFolder folder;
  Stopping stopping;
  stopping.formula.fails_at = {3};
  RunGrid grid = grid_in(folder.file("parts"));
  grid.leave_out_failed = true;
  const PointRuns found =
      run_points(stopping, grid, std::vector<std::vector<double>>{{1, 3}, {1, 4}, {2, 3}, {2, 5}});
  EXPECT_EQ(found.failed, (std::vector<std::size_t>{0, 2}));
  EXPECT_EQ(found.computed, (std::vector<std::size_t>{1, 3}));
  EXPECT_TRUE(is_there(found.runs[3]));
  EXPECT_EQ(stopping.formula.solved, 4);
}

TEST(GridWithout, LosesAsFewPointsAsItCan) {
  using Kept = std::vector<std::vector<std::size_t>>;
  const std::vector<std::size_t> shape = {5, 3};
  // A corner: a row of three points goes, not a column of five.
  EXPECT_EQ(grid_without(shape, std::vector<std::size_t>{14}), (Kept{{0, 1, 2, 3}, {0, 1, 2}}));
  // Three of a column of five: the column goes, which is five points and not nine.
  EXPECT_EQ(grid_without(shape, std::vector<std::size_t>{1, 4, 10}), (Kept{{0, 1, 2, 3, 4}, {0, 2}}));
  EXPECT_EQ(grid_without(shape, std::vector<std::size_t>{}), (Kept{{0, 1, 2, 3, 4}, {0, 1, 2}}));
  EXPECT_THAT(message_of<NumericalError>([&] {
                (void)grid_without(shape, std::vector<std::size_t>{0, 4, 8});
              }),
              HasSubstr("3 of the grid's runs failed, too many to do without"));
}

TEST(GridRuns, SolutionsThatDoNotBelongTogetherAreRefused) {
  class Growing final : public Simulator {
   public:
    [[nodiscard]] std::string key(std::span<const double> p) const override { return std::to_string(p[0]); }
    [[nodiscard]] Snapshots solve(std::span<const double> p) override {
      Snapshots solution;
      solution.axes = {{"a", {p[0]}, "1", ""}};
      solution.time = {0};
      solution.values.assign(static_cast<std::size_t>(p[0]), 1.0);
      return solution;
    }
  };
  const files::TestFolder folder;
  Growing growing;
  RunGrid grid = grid_in(folder.file("parts"));
  grid.axes = {{"a", {1, 2}, "1", ""}};
  EXPECT_THAT(message_of<NumericalError>([&] { (void)run_grid(growing, grid); }),
              HasSubstr("full-order run 2 of 2 (a = 2) failed: it has 2 dofs, others 1"));
}

}  // namespace
}  // namespace knothe::model
