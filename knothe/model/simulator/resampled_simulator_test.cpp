#include "knothe/model/simulator/resampled_simulator.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/simulator/grid_runs.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using testing::HasSubstr;

/// At load t the opening is a t² (strictly growing, but for a < 0) and u = 3 a t² + t, so that u at an
/// opening w is 3 w + √(w/a).
class Opening final : public Simulator {
 public:
  int solved = 0;
  int steps = 2000;

  [[nodiscard]] std::string key(std::span<const double> p) const override {
    return "opening " + std::to_string(p[0]);
  }
  [[nodiscard]] Snapshots solve(std::span<const double> p) override {
    ++solved;
    Snapshots solution;
    solution.axes = {{"a", {p[0]}, "1", ""}};
    solution.quantities = {{"u", "m"}, {"twice", "m"}};
    solution.lift.assign(2 * static_cast<std::size_t>(steps), 0.0);
    solution.outputs = {{"opening", {"m", ""}, {}}, {"load", {"1", ""}, {}}};
    for (int i = 1; i <= steps; ++i) {
      const double t = static_cast<double>(i) / steps, w = p[0] * t * t, u = 3 * w + t;
      solution.time.push_back(t);
      solution.values.insert(solution.values.end(), {u, 2 * u});
      solution.outputs[0].values.push_back(w);
      solution.outputs[1].values.push_back(t);
    }
    return solution;
  }
};

ResampledSimulator resampler(TimeAxis axis, Opening** inner = nullptr) {
  auto opening = std::make_unique<Opening>();
  if (inner != nullptr) *inner = opening.get();
  return {std::move(opening), std::move(axis)};
}

TEST(ResampledSimulator, GivesFieldAndOutputsAtValuesOfAnOutput) {
  ResampledSimulator simulator = resampler({"opening", {0.01, 0.3, 0.5, 0.99}});
  for (const double a : {1.0, 1.7}) {
    const Snapshots solution = simulator.solve(std::vector{a});
    EXPECT_EQ(solution.time, (std::vector{0.01, 0.3, 0.5, 0.99}));
    EXPECT_TRUE(solution.lift.empty());
    for (std::size_t i = 0; i < solution.time.size(); ++i) {
      const double w = solution.time[i], load = std::sqrt(w / a);
      // Linear between steps of 1/2000: off by at most h²/8 |d²load/dw²|, with h = 2 a load / 2000.
      const double tolerance = 1e-6 / load;
      EXPECT_NEAR(solution.outputs[1].values[i], load, tolerance);
      EXPECT_NEAR(solution.outputs[0].values[i], w, 1e-15);
      EXPECT_NEAR(solution.values[2 * i], 3 * w + load, tolerance);
      EXPECT_NEAR(solution.values[2 * i + 1], 2 * (3 * w + load), 2 * tolerance);
    }
  }
}

TEST(ResampledSimulator, TakesADofThatHasAName) {
  ResampledSimulator simulator = resampler({"twice", {1.0, 8.0}});
  const Snapshots solution = simulator.solve(std::vector{1.0});
  EXPECT_NEAR(solution.values[0], 0.5, 1e-12);
  EXPECT_NEAR(solution.values[3], 8.0, 1e-12);  // the last step itself
}

TEST(ResampledSimulator, SaysWhyAnOutputIsNoAxis) {
  const auto message = [](TimeAxis axis, double a) {
    return message_of<Error>([&] { (void)resampler(std::move(axis)).solve(std::vector{a}); });
  };
  EXPECT_THAT(
      message({"opening", {0.1, 0.2}}, -1.0),
      HasSubstr("opening cannot be the time of [offline]: it must grow from step to step, but is -1e-06 m "
                "at 0.001 after -2.5e-07 m at 0.0005; take an output that grows"));
  EXPECT_THAT(
      message({"opening", {0.1, 1.2}}, 1.0),
      HasSubstr("opening reaches 1 m only, and [offline] time_values end at 1.2: let the solver go on "
                "further"));
  EXPECT_THAT(
      message({"opening", {1e-9, 0.2}}, 1.0),
      HasSubstr("opening is 2.5e-07 m at the first step already, and [offline] time_values begin at 1e-09"));
  EXPECT_THAT(message({"openin", {0.1, 0.2}}, 1.0),
              HasSubstr("[offline] time = \"openin\": the full-order model has no such output (did you mean "
                        "\"opening\"?); it has opening, load, u, twice"));
}

TEST(ResampledSimulator, KeepsTheSolversRunsForAnotherAxis) {
  const files::TestFolder folder;
  RunGrid grid;
  grid.axes = {{"a", {1, 1.5, 2}, "1", ""}};
  grid.parts_folder = folder.file("parts");
  grid.quiet = true;
  Opening *first = nullptr, *second = nullptr;
  ResampledSimulator one = resampler({"opening", {0.2, 0.4}}, &first),
                     other = resampler({"opening", {0.1, 0.6, 0.9}}, &second);
  const GridRuns runs = run_grid(one, grid);
  EXPECT_EQ(first->solved, 3);
  EXPECT_EQ(runs.snapshots.time, (std::vector{0.2, 0.4}));
  EXPECT_NEAR(runs.snapshots.solution(2)[0], 3 * 0.2 + std::sqrt(0.1), 1e-5);
  EXPECT_EQ(run_grid(other, grid).snapshots.time.size(), 3u);
  EXPECT_EQ(second->solved, 0);
  EXPECT_TRUE(run_grid(one, grid).runs[0].resumed);
}

TEST(ResampledSimulator, NamesTheRunThatDoesNotReachTheEnd) {
  const files::TestFolder folder;
  RunGrid grid;
  grid.axes = {{"a", {1, 2, 3}, "1", ""}};
  grid.parts_folder = folder.file("parts");
  grid.quiet = true;
  ResampledSimulator simulator = resampler({"opening", {0.2, 1.5}});
  EXPECT_THAT(message_of<Error>([&] { (void)run_grid(simulator, grid); }),
              HasSubstr("full-order run 1 of 3 (a = 1) failed: opening reaches 1 m only"));
}

}  // namespace
}  // namespace knothe::model
