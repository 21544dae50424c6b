#include "knothe/offline/full_order/beam_simulator.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/offline/full_order/child_processes.hpp"

namespace {

using namespace knothe;
using namespace knothe::offline;
using files::message_of;
using model::GridRuns;
using model::RunGrid;

/// A very coarse beam, ten steps.
BeamProblem small_problem() {
  BeamProblem problem;
  problem.beam.element = 0.02;
  problem.beam.largest_element = 0.06;
  problem.solver.steps = 10;
  return problem;
}

RunGrid small_grid(const std::string& folder, int processes = 2) {
  RunGrid grid;
  grid.axes = {{"Y0", {0.8, 1.2}, "1", "threshold", 216.0},
               {"Ad", {0.7, 1.0, 1.3}, "1", "brittleness", 2.25e-3}};
  grid.parts_folder = folder;
  grid.processes = processes;
  grid.quiet = true;
  return grid;
}

void expect_same(const model::Snapshots& a, const model::Snapshots& b) {
  EXPECT_EQ(a.values, b.values);
  for (std::size_t i = 0; i < a.outputs.size(); ++i) EXPECT_EQ(a.outputs[i].values, b.outputs[i].values);
}

TEST(BeamRuns, take_parameters_of_the_elastic_body) {
  const files::TestFolder folder;
  BeamProblem problem = small_problem();
  problem.solver.steps = 2;
  problem.solver.displacement = 4e-5;  // elastic
  problem.beam.support_stiffness = 2e8;
  RunGrid grid = small_grid(folder.file("parts"));
  grid.axes = {{"E", {0.9, 1.0}, "1", "modulus", 30e9},
               {"support_stiffness", {0.5, 1.0}, "1", "springs", 2e8},
               {"load_offset", {-1.0, 0.0, 1.0}, "1", "offset", 0.004}};
  const GridRuns runs = run_snapshots(problem, grid);
  const auto force = [&](std::size_t point) { return runs.snapshots.outputs[0].values[2 * point]; };
  // In the first, elastic step: E and the springs are in series, the beam's own stiffness from rigid
  // supports.
  BeamProblem rigid = problem;
  rigid.beam.support_stiffness = 0;
  const double beam = make_full_order_model(rigid).run({}).steps[0].reaction_force / 2e-5;
  const auto series = [&](double modulus, double support) {
    return 2e-5 / (1 / (modulus * beam) + 1 / (2 * support));
  };
  EXPECT_NEAR(force(1), series(0.9, 1e8), 1e-3 * force(1));
  EXPECT_NEAR(force(10), series(1.0, 2e8), 1e-3 * force(10));
  // A beam loaded off its middle is stiffer, alike on both sides but for the support that holds u_x.
  EXPECT_GT(force(9), 1.00002 * force(10));
  EXPECT_NEAR(force(9), force(11), 1e-3 * force(9));
  grid.axes[2].name = "load_ofset";
  const std::string text = message_of<ProjectError>([&] { static_cast<void>(run_snapshots(problem, grid)); });
  EXPECT_NE(text.find("(did you mean \"load_offset\"?)"), std::string::npos) << text;
}

TEST(BeamRuns, hold_the_full_order_runs_in_the_grids_order) {
  const files::TestFolder folder;
  const BeamProblem problem = small_problem();
  const GridRuns runs = run_snapshots(problem, small_grid(folder.file("parts")));
  const auto& snapshots = runs.snapshots;
  ASSERT_EQ(snapshots.grid_shape(), (files::Shape{2, 3}));
  FullOrderModel model = make_full_order_model(problem);
  const auto dofs = static_cast<std::size_t>(model.structure().dof_count());
  ASSERT_EQ(snapshots.dof_count(), dofs);
  // Grid point (1, 0): Y0 = 1.2, Ad = 0.7.
  const FullOrderResult direct = model.run({1.2 * 216.0, 0.7 * 2.25e-3});
  const auto solution = snapshots.solution(3);
  EXPECT_EQ(std::vector<double>(solution.begin(), solution.end()), direct.displacement);
  EXPECT_EQ(runs.runs[3].parameters, (std::vector<double>{1.2, 0.7}));
  EXPECT_EQ(runs.runs[3].record.numbers.at("newton_iterations"), direct.newton_iterations());
  EXPECT_FALSE(runs.runs[3].resumed);
  for (std::size_t step = 0; step < 10; ++step) {
    EXPECT_EQ(snapshots.outputs[0].values[3 * 10 + step], direct.steps[step].reaction_force);
    EXPECT_EQ(snapshots.outputs[1].values[3 * 10 + step], direct.steps[step].crack_mouth_opening);
    EXPECT_EQ(snapshots.outputs[2].values[3 * 10 + step], direct.steps[step].imposed_displacement);
    EXPECT_NEAR(snapshots.time[step], direct.steps[step].imposed_displacement / 4e-4, 1e-15);
  }
  // The field where the load is prescribed, and the lift, which is the whole solution while nothing is
  // damaged.
  for (std::size_t dof = 0; dof < dofs; ++dof) {
    EXPECT_NEAR(snapshots.lift[dof], solution[dof], 1e-15);
    if (model.structure().unit_prescribed()[dof] < 0) {
      EXPECT_NEAR(solution[9 * dofs + dof], -4e-4, 1e-18);
    }
    EXPECT_EQ(snapshots.dofs.components[dof], static_cast<std::int64_t>(dof % 3));
  }
  ASSERT_TRUE(snapshots.mesh.has_value());
  EXPECT_EQ(snapshots.mesh->cell_count(), static_cast<std::size_t>(model.structure().mesh().cell_count()));
}

TEST(BeamRuns, are_bit_identical_for_any_number_of_processes_and_when_resumed) {
  const files::TestFolder folder;
  const BeamProblem problem = small_problem();
  const GridRuns one = run_snapshots(problem, small_grid(folder.file("one"), 1));
  const GridRuns three = run_snapshots(problem, small_grid(folder.file("three"), 3));
  expect_same(one.snapshots, three.snapshots);

  // All there: nothing is run again, not even with other names for the same physical values.
  const GridRuns again = run_snapshots(problem, small_grid(folder.file("one"), 2));
  for (const auto& run : again.runs) EXPECT_TRUE(run.resumed);
  expect_same(one.snapshots, again.snapshots);

  // One missing and one damaged: exactly these two are run again.
  std::vector<std::filesystem::path> parts;
  for (const auto& entry : std::filesystem::directory_iterator(folder.file("one")))
    parts.push_back(entry.path());
  std::filesystem::remove(parts.at(0));
  std::ofstream(parts.at(1), std::ios::trunc) << "not HDF5";
  const GridRuns repaired = run_snapshots(problem, small_grid(folder.file("one"), 2));
  EXPECT_EQ(
      std::count_if(repaired.runs.begin(), repaired.runs.end(), [](const auto& run) { return !run.resumed; }),
      2);
  expect_same(one.snapshots, repaired.snapshots);

  // Another loading is another run.
  BeamProblem other = problem;
  other.solver.steps = 5;
  const GridRuns shorter = run_snapshots(other, small_grid(folder.file("one"), 2));
  for (const auto& run : shorter.runs) EXPECT_FALSE(run.resumed);
}

TEST(BeamRuns, a_run_that_dies_is_named_and_the_finished_ones_stay) {
  const files::TestFolder folder;
  RunGrid grid = small_grid(folder.file("parts"), 1);
  grid.axes[0].nodes = {0.75, 1.0};
  grid.axes[1].nodes = {0.9, 1.0};
  (void)run_snapshots(small_problem(), grid);
  grid.axes[0].nodes = {0.75, 1.0, 1.25};
  // Files beyond this size kill who writes them (SIGXFSZ).
  std::fflush(nullptr);
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  const rlimit small{4096, limit.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  const std::string message = message_of<NumericalError>([&] { (void)run_snapshots(small_problem(), grid); });
  setrlimit(RLIMIT_FSIZE, &limit);
  EXPECT_NE(message.find("full-order run 5 of 6 (Y0 = 1.25, Ad = 0.9) failed: killed by signal 25"),
            std::string::npos)
      << message;
  EXPECT_NE(message.find("4 of 6 runs are kept in"), std::string::npos) << message;
  const GridRuns rest = run_snapshots(small_problem(), grid);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(rest.runs[i].resumed, i < 4);
}

TEST(BeamRuns, an_interruption_tells_what_is_kept) {
  const files::TestFolder folder;
  request_cancellation();
  const std::string message = message_of<Interrupted>(
      [&] { (void)run_snapshots(small_problem(), small_grid(folder.file("parts"))); });
  request_cancellation(false);
  EXPECT_NE(message.find("0 of 6 runs are kept in " + folder.file("parts")), std::string::npos) << message;
}

TEST(BeamRuns, faulty_axes_are_refused_with_the_reason) {
  const files::TestFolder folder;
  const auto refused = [&](auto change) {
    RunGrid grid = small_grid(folder.file("parts"));
    change(grid);
    return message_of<ProjectError>([&] { (void)run_snapshots(small_problem(), grid); });
  };
  EXPECT_NE(
      refused([](auto& g) { g.axes[0].name = "Yo"; }).find("no parameter \"Yo\" (did you mean \"Y0\"?)"),
      std::string::npos);
  EXPECT_NE(refused([](auto& g) {
              g.axes[1].nodes = {1.0, 0.5};
            }).find("Ad: the axis must increase"),
            std::string::npos);
  EXPECT_NE(refused([](auto& g) { g.axes[1].nodes = {}; }).find("Ad: its axis has 0 node(s)"),
            std::string::npos);
  EXPECT_NE(refused([](auto& g) { g.axes[1].name = "Y0"; }).find("two axes"), std::string::npos);
  EXPECT_NE(refused([](auto& g) {
              g.axes[1].nodes = {-1.0, 1.0};
            }).find("Ad is -0.00225"),
            std::string::npos);
  EXPECT_NE(refused([](auto& g) { g.axes.clear(); }).find("at least one"), std::string::npos);
  EXPECT_NE(refused([](auto& g) { g.processes = 0; }).find("processes is 0"), std::string::npos);
}

TEST(ChildProcesses, do_every_job_once_and_pass_on_what_a_failing_one_says) {
  const files::TestFolder folder;
  int reported = 0;
  run_in_processes(
      7, 3, [&](int job) { std::ofstream(folder.file(std::to_string(job))) << job; },
      [&](int done) { reported = done; }, [] { return std::string(); });
  EXPECT_EQ(folder.number_of_files(), 7u);
  EXPECT_EQ(reported, 7);

  const auto failure = [](auto body) {
    try {
      run_in_processes(
          3, 2, body, [](int) {}, [] { return std::string(); });
    } catch (const JobFailure& caught) {
      return caught;
    }
    return JobFailure{-1, 0, ""};
  };
  const JobFailure thrown = failure([](int job) {
    if (job == 1) throw IoError("disk full");
  });
  EXPECT_EQ(thrown.job, 1);
  EXPECT_EQ(thrown.exit_status, 5);
  EXPECT_EQ(thrown.message, "disk full");
  const JobFailure killed = failure([](int job) {
    if (job == 2) std::raise(SIGKILL);
  });
  EXPECT_EQ(killed.job, 2);
  EXPECT_NE(killed.message.find("signal 9"), std::string::npos);
}

TEST(CrackTable, has_a_row_per_length_and_a_column_per_degree_of_freedom) {
  const BeamProblem problem = small_problem();
  const HexahedronMesh mesh = make_mesh(problem);
  const CrackTable table = crack_table(problem, {.count = 8, .spacing = 0.01}, dofs(mesh));
  EXPECT_EQ(table.lengths.size(), 8u);
  EXPECT_EQ(table.values.size(), 8 * mesh.points.size());
  EXPECT_NEAR(table.lengths[7], 0.07, 1e-15);
  // u_x of the right support moves outward ever more as the crack grows.
  for (std::size_t i = 1; i < 8; ++i) EXPECT_LT(table.stiffness[i], table.stiffness[i - 1]);
}

TEST(OfflineFacade, runs_a_gmsh_mesh_like_any_other) {
  BeamProblem problem;
  problem.gmsh_file = std::string(KNOTHE_OFFLINE_FOLDER) + "/testdata/beam41.msh";
  problem.solver.steps = 20;
  FullOrderModel model = make_full_order_model(problem);
  const FullOrderResult result = model.run(problem.reference);
  EXPECT_TRUE(result.steps_without_equilibrium().empty());
  const auto& last = result.steps.back();
  EXPECT_GT(last.damaged_points, 0);
  EXPECT_NEAR(last.external_work, last.stored_energy + last.dissipated_energy, 1e-8 * last.external_work);
  const model::Snapshots snapshots = as_snapshots(problem, model.structure(), result);
  EXPECT_EQ(snapshots.values.size(), 20 * snapshots.dofs.components.size());
}

}  // namespace
