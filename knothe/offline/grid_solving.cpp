#include "knothe/offline/grid_solving.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/model/grid/grid_refinement.hpp"
#include "knothe/model/grid/sparse_grid.hpp"
#include "knothe/offline/distributed/ranks.hpp"
#include "knothe/offline/full_order/beam_simulator.hpp"
#include "knothe/offline/latin/latin_model.hpp"
#include "knothe/offline/posterior_judge.hpp"
#include "knothe/offline/problem.hpp"

namespace knothe::offline {
namespace {

using model::GridSolutions;
using project::OfflineOptions;

SolvedGrid run_grid(model::Simulator& solver, const model::RunGrid& grid,
                    const files::CommandOutput& output) {
  const model::JobShare share = share_of_ranks();
  model::GridRuns runs = model::run_grid(solver, grid, share);
  SolvedGrid solved;
  solved.failed = runs.failed;
  solved.solutions.snapshots = std::move(runs.snapshots);
  if (share.rank != 0) return solved;
  std::size_t resumed = 0;
  for (const model::RunSummary& run : runs.runs) {
    resumed += run.resumed ? 1 : 0;
    report_run(run, output);
  }
  output.text(fmt::format("{} full-order runs ({} reused from an earlier call)", runs.runs.size(), resumed));
  return solved;
}

/// Largest error at `dofs` of splines through the uncompressed snapshots, m.
double interpolation_error(const GridSolutions& solutions, const std::vector<std::size_t>& dofs,
                           const std::vector<model::OffGridSolution>& off_grid) {
  const model::ObservedModel model = model::observe_snapshots(solutions.at_dofs(dofs));
  double largest = 0;
  for (const model::OffGridSolution& solution : off_grid)
    largest =
        std::max(largest, largest_error(model, solution.parameters, [&](std::size_t step, std::size_t i) {
                   return solution.values[step * solutions.dof_count() + dofs[i]];
                 }));
  return largest;
}

/// The next level of a sparse grid, whose runs stay; else the grid with nodes beside its weakest one.
model::RunGrid finer(model::RunGrid grid, const model::Snapshots& snapshots,
                     const std::vector<std::size_t>& dofs) {
  grid.axes = snapshots.axes;  // without the nodes whose runs have failed
  if (grid.sparse_level >= 0 && grid.sparse_level < model::finest_level(grid.axes)) {
    ++grid.sparse_level;
    return grid;
  }
  const auto weak = model::weakest_node(snapshots, dofs);
  if (!weak)
    throw ProjectError("[offline.adaptive]: grid_error needs an axis of at least three nodes to begin with");
  grid.axes = model::refined(grid.axes, *weak);
  if (grid.sparse_level >= 0) grid.sparse_level = model::finest_level(grid.axes);
  return grid;
}

/// Removes the solutions at points that are not in the box of these axes.
void remove_outside(const std::vector<model::Axis>& axes, std::vector<model::OffGridSolution>& solutions) {
  std::erase_if(solutions, [&](const model::OffGridSolution& solution) {
    for (Index i = 0; i < std::ssize(axes); ++i)
      if (solution.parameters[i] < axes[i].nodes.front() || solution.parameters[i] > axes[i].nodes.back())
        return true;
    return false;
  });
}

}  // namespace

void report_run(const model::RunSummary& run, const files::CommandOutput& output) {
  nlohmann::ordered_json line = {{"run", run.parameters}, {"resumed", run.resumed}};
  for (const auto& [name, value] : run.record.numbers) line[name] = value;
  const std::vector<int>& steps = run.record.steps_without_equilibrium;
  line["steps_without_equilibrium"] = steps;
  output.record(line);
  if (!steps.empty())
    fmt::print(
        stderr,
        "knothe: warning: at parameters ({:g}) steps {} are not in equilibrium to 1e-8; see the output "
        "equilibrium_residual of the model\n",
        fmt::join(run.parameters, ", "), fmt::join(steps, ", "));
}

GridSolutions solve_latin(const project::Project& project, const std::string& parts_folder,
                          const files::CommandOutput& output) {
  const OfflineOptions& from = *project.offline;
  LatinOptions options;
  options.accuracy = from.latin_accuracy;
  options.window = from.latin_window;
  options.threads = from.processes;
  options.quiet = false;
  LatinModel latin = solve_latin_grid(beam_problem(project), parameter_axes(project), options, parts_folder,
                                      from.latin_start);
  const LatinSolution& solution = latin.solution;
  for (const LatinIteration& it : solution.history)
    output.record({{"first_step", it.first_step},
                   {"last_step", it.last_step},
                   {"round", it.round},
                   {"working_modes", it.working_modes},
                   {"space_modes", it.archived_modes},
                   {"points", it.lanes},
                   {"residual", it.residual},
                   {"correction_m", it.correction},
                   {"indicator", it.indicator},
                   {"cpu_seconds", it.cpu_seconds}});
  for (const auto& [point, windows] : inaccurate_points(solution))
    fmt::print(stderr,
               "knothe: warning: at parameters ({:g}) {} window(s) of steps were left before they were "
               "accurate; see "
               "the output equilibrium_residual of the model\n",
               fmt::join(latin.grid.snapshots.parameters_at(point), ", "), windows);
  output.text(fmt::format("LATIN-PGD: {} grid points, {} space modes, {} global stages, {:.1f} s of CPU time",
                          latin.grid.snapshots.grid_size(), solution.space.cols(), solution.history.size(),
                          solution.cpu_seconds));
  return std::move(latin.grid);
}

model::RunGrid run_grid_of(const project::Project& project, const std::string& parts_folder) {
  const OfflineOptions& options = *project.offline;
  return {.axes = parameter_axes(project),
          .parts_folder = parts_folder,
          .sparse_level = options.sparse_level.value_or(-1),
          .processes = options.processes,
          .quiet = share_of_ranks().rank != 0,
          .leave_out_failed = options.leave_out_failed};
}

SolvedGrid solve_project_grid(const project::Project& project, model::Simulator& solver,
                              const std::string& parts_folder, const files::CommandOutput& output) {
  const OfflineOptions& options = *project.offline;
  model::RunGrid grid = run_grid_of(project, parts_folder);
  // The off-grid runs judge an adaptive grid; without one they come last, when the grid's runs are safe.
  std::vector<model::OffGridSolution> off_grid;
  if (options.adaptive_grid_error) off_grid = solve_off_grid(project, solver, grid, share_of_ranks());
  while (true) {
    SolvedGrid solved = run_grid(solver, grid, output);
    if (!options.adaptive_grid_error) return solved;
    const GridSolutions& solutions = solved.solutions;
    remove_outside(solutions.snapshots.axes, off_grid);
    solved.off_grid = off_grid;
    const std::vector<std::size_t> dofs =
        checked_dofs(project, solutions.dofs(), solutions.snapshots.quantities);
    const double error = interpolation_error(solutions, dofs, off_grid);
    fmt::print(stderr, "parameter grid of {} points: off the grid at most {:.3f} µm on the observed dofs\n",
               solutions.snapshots.grid_size(), 1e6 * error);
    if (error <= *options.adaptive_grid_error) return solved;
    model::RunGrid next = finer(grid, solutions.snapshots, dofs);
    if (const std::size_t runs = points_of(next).size();
        runs > static_cast<std::size_t>(options.adaptive_runs)) {
      fmt::print(stderr,
                 "knothe: warning: grid_error {:g} m is not met ({:g} m), and a finer grid would have {} "
                 "points, more than [offline.adaptive] runs = {}\n",
                 *options.adaptive_grid_error, error, runs, options.adaptive_runs);
      return solved;
    }
    grid = std::move(next);
  }
}

std::vector<std::vector<double>> off_grid_points(const project::Project& project,
                                                 const std::vector<model::Axis>& axes) {
  constexpr std::uint64_t k_seed = 271;  // not that of `model verify`, whose points must be new
  return points_in_box(axes, project.offline->scaling ? 24 : 8, k_seed);
}

std::vector<model::OffGridSolution> solve_off_grid(const project::Project& project, model::Simulator& solver,
                                                   model::RunGrid grid, const model::JobShare& share) {
  grid.label = "off-grid runs";
  const model::PointRuns found = run_points(solver, grid, off_grid_points(project, grid.axes), share);
  std::vector<model::Snapshots> solutions;
  for (Index i = 0; i < std::ssize(found.runs); ++i)
    if (!std::binary_search(found.failed.begin(), found.failed.end(), i))
      solutions.push_back(model::read_run(found.runs[i]).solution);
  return model::fields_of(std::move(solutions));
}

}  // namespace knothe::offline
