#include "knothe/model/simulator/solver_process.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/simulator/kept_solutions.hpp"

namespace knothe::model {
namespace {

using testing::HasSubstr;

/// A folder with a solution of a structure of two dofs at three times, and a shell script that copies it.
class SolverProcessTest : public testing::Test {
 protected:
  void SetUp() override {
    Snapshots solution;
    solution.axes = {{.name = "a", .nodes = {1.25}}, {.name = "b", .nodes = {-0.5}}};
    solution.time = {0, 1, 2};
    solution.values = {1, 2, 3, 4, 5, 6};
    write_snapshots(solution, folder_ + "solution.h5");
  }
  SolverProcess solver(const std::string& script, double time_limit_s = 0) {
    SolverProcessOptions options;
    options.words = {"sh", "-c", script, "solver"};
    options.names = {"a", "b"};
    options.identity = "two dofs";
    options.processes = 2;
    options.time_limit_s = time_limit_s;
    return SolverProcess(options);
  }
  files::TestFolder files_;
  const std::string folder_ = files_.file("");
};

TEST_F(SolverProcessTest, GivesTheSolutionThatTheProgramWrites) {
  // $1 … $4: --at POINT -o FILE
  SolverProcess process = solver("test \"$2\" = a=1.25,b=-0.5 && cp " + folder_ + "solution.h5 \"$4\"");
  const Snapshots solution = process.solve(std::vector{1.25, -0.5});
  EXPECT_EQ(solution.values, (std::vector<double>{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(solution.parameters_at(0), (std::vector<double>{1.25, -0.5}));
}

TEST_F(SolverProcessTest, TheFileMayHaveItsParametersInAnotherOrder) {
  SolverProcessOptions options;
  options.words = {"sh", "-c", "cp " + folder_ + "solution.h5 \"$4\"", "solver"};
  options.names = {"b", "a"};
  EXPECT_EQ(SolverProcess(options).solve(std::vector{-0.5, 1.25}).parameters_at(0),
            (std::vector<double>{-0.5, 1.25}));
}

TEST_F(SolverProcessTest, SolvesAllPointsAndTellsEachThatIsFinished) {
  SolverProcess process = solver("cp " + folder_ + "solution.h5 \"$4\"");
  std::vector<std::size_t> told;
  const auto solutions = process.solve_all(std::vector<std::vector<double>>(5, {1.25, -0.5}),
                                           [&](std::size_t done) { told.push_back(done); });
  EXPECT_EQ(solutions.size(), 5u);
  EXPECT_EQ(told, (std::vector<std::size_t>{1, 2, 3, 4, 5}));
}

TEST_F(SolverProcessTest, AFailureSaysWhereAndWhatTheProgramSaid) {
  SolverProcess process = solver("echo the mesh is tangled >&2; exit 6");
  const std::string message = files::message_of<Error>([&] { (void)process.solve(std::vector{1.25, -0.5}); });
  EXPECT_THAT(message, HasSubstr("the full-order model at a = 1.25, b = -0.5 was not solved"));
  EXPECT_THAT(message, HasSubstr("status 6"));
  EXPECT_THAT(message, HasSubstr("the mesh is tangled"));
}

TEST_F(SolverProcessTest, ARunThatTakesTooLongIsEnded) {
  SolverProcess process = solver("sleep 60", 0.05);
  EXPECT_THAT(files::message_of<Error>([&] {
                (void)process.solve(std::vector{1.25, -0.5});
              }),
              HasSubstr("was not solved within 0.05 s"));
}

TEST_F(SolverProcessTest, AProgramThatIsNotThereIsNamed) {
  SolverProcessOptions options;
  options.words = {"no-such-solver"};
  options.names = {"a"};
  SolverProcess process(options);
  EXPECT_THAT(files::message_of<Error>([&] { (void)process.solve(std::vector{1.0}); }),
              HasSubstr("no-such-solver"));
}

TEST_F(SolverProcessTest, AFileOfSeveralPointsIsRefused) {
  Snapshots grid;
  grid.axes = {{.name = "a", .nodes = {1, 2}}, {.name = "b", .nodes = {0}}};
  grid.time = {0};
  grid.values = {1, 2};
  write_snapshots(grid, folder_ + "grid.h5");
  SolverProcess process = solver("cp " + folder_ + "grid.h5 \"$4\"");
  EXPECT_THAT(files::message_of<Error>([&] {
                (void)process.solve(std::vector{1.25, -0.5});
              }),
              HasSubstr("a grid of 2 points of 2 parameters, not one solution of 2"));
}

TEST_F(SolverProcessTest, WhatIsKeptIsNotSolvedAgain) {
  SolverProcessOptions options;
  options.words = {"sh", "-c", "echo run >> " + folder_ + "runs; cp " + folder_ + "solution.h5 \"$4\"",
                   "solver"};
  options.names = {"b", "a"};  // not the file's order
  options.identity = "two dofs";
  options.keep = folder_ + "kept";
  const std::vector<double> point = {-0.5, 1.25};
  const auto runs = [&] {
    std::ifstream file(folder_ + "runs");
    return std::count(std::istreambuf_iterator<char>(file), {}, '\n');
  };
  EXPECT_EQ(SolverProcess(options).solve(point).parameters_at(0), point);
  SolverProcess again(options);
  EXPECT_EQ(again.solve_all(std::vector<std::vector<double>>{point}, {}).front().values,
            (std::vector<double>{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(runs(), 1);
  const auto kept = kept_solutions(again, options.keep);
  ASSERT_EQ(kept.size(), 1u);
  EXPECT_EQ(kept.front().parameters_at(0), point);
  // Of another solver it is no solution, and what cannot be read is none of anybody.
  options.identity = "three dofs";
  EXPECT_TRUE(kept_solutions(SolverProcess(options), options.keep).empty());
  EXPECT_TRUE(kept_solutions(again, folder_ + "nowhere").empty());
  std::ofstream(solution_file(options.keep, again.key(point))) << "not what it was";
  EXPECT_TRUE(kept_solutions(again, options.keep).empty());
  EXPECT_EQ(again.solve(point).parameters_at(0), point);
  EXPECT_EQ(runs(), 2);
}

TEST_F(SolverProcessTest, ItIsEndedByWhoeverStartedIt) {
  std::stop_source stop;
  SolverProcessOptions options;
  options.words = {"sh", "-c", "touch " + folder_ + "begun; sleep 60", "solver"};
  options.names = {"a"};
  options.stop = stop.get_token();
  SolverProcess process(options);
  std::jthread other([&] {
    while (!std::filesystem::exists(folder_ + "begun")) std::this_thread::yield();
    stop.request_stop();
  });
  EXPECT_THROW((void)process.solve(std::vector{1.0}), Interrupted);
}

}  // namespace
}  // namespace knothe::model
