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

/// What both forms of LATIN-PGD take from a project.
template <typename Options>
Options latin_options(const OfflineOptions& project) {
  Options options;
  if (project.latin_accuracy) options.accuracy = *project.latin_accuracy;
  options.window = project.latin_window;
  options.threads = project.processes;
  options.quiet = false;
  return options;
}

GridSolutions solve_jointly(const OfflineOptions& options, const BeamProblem& problem,
                            const std::vector<model::Axis>& axes, const std::string& parts_folder,
                            const files::CommandOutput& output) {
  LatinModel latin = solve_latin_grid(problem, axes, latin_options<LatinOptions>(options), parts_folder,
                                      options.latin_start);
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

GridSolutions solve_separated(const OfflineOptions& options, const BeamProblem& problem,
                              const std::vector<model::Axis>& axes, const std::string& parts_folder,
                              const files::CommandOutput& output) {
  auto separated = latin_options<SeparatedOptions>(options);
  separated.max_terms = options.latin_terms;
  LatinModel latin = solve_separated_grid(problem, axes, separated, parts_folder, options.latin_start);
  for (const SeparatedIteration& it : latin.separated)
    output.record({{"steps", it.steps},
                   {"round", it.round},
                   {"terms", it.terms},
                   {"space_modes", it.space_modes},
                   {"energy_error", it.energy_error},
                   {"residual", it.residual},
                   {"correction_m", it.correction},
                   {"indicator", it.indicator},
                   {"relaxation", it.relaxation},
                   {"cpu_seconds", it.cpu_seconds}});
  const auto terms = latin.grid.terms ? latin.grid.terms->time.cols() : 0;
  const double left = latin.separated.empty() ? 0.0 : 1e6 * latin.separated.back().correction;  // µm
  if (!inaccurate_points(latin.solution).empty())
    fmt::print(stderr,
               "knothe: warning: with {} terms out-of-balance forces are left that are worth {:.3g} µm "
               "([offline.latin] accuracy asks for {:.3g} µm): {}\n",
               terms, left, 1e6 * separated.accuracy,
               terms < separated.max_terms
                   ? "more terms gain nothing; take the joint form (leave separation away)"
                   : fmt::format("raise [offline.latin] terms ({}), or take the joint form (leave separation "
                                 "away)",
                                 separated.max_terms));
  output.text(fmt::format(
      "LATIN-PGD, fully separated: {} grid points, {} terms, {} global stages, out-of-balance forces worth "
      "{:.2g} µm at most, {:.1f} s of CPU time",
      latin.grid.snapshots.grid_size(), terms, latin.separated.size(), left, latin.solution.cpu_seconds));
  return std::move(latin.grid);
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
  const OfflineOptions& options = *project.offline;
  return (options.latin_full ? solve_separated : solve_jointly)(
      options, beam_problem(project), parameter_axes(project), parts_folder, output);
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
  if (options.adaptive_grid_error) off_grid = solve_off_grid(solver, grid, share_of_ranks());
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

std::vector<std::vector<double>> off_grid_points(const std::vector<model::Axis>& axes) {
  constexpr int k_points = 8;
  constexpr std::uint64_t k_seed = 271;  // not that of `model verify`, whose points must be new
  return points_in_box(axes, k_points, k_seed);
}

std::vector<model::OffGridSolution> solve_off_grid(model::Simulator& solver, model::RunGrid grid,
                                                   const model::JobShare& share) {
  grid.label = "off-grid runs";
  const model::PointRuns found = run_points(solver, grid, off_grid_points(grid.axes), share);
  std::vector<model::Snapshots> solutions;
  for (Index i = 0; i < std::ssize(found.runs); ++i)
    if (!std::binary_search(found.failed.begin(), found.failed.end(), i))
      solutions.push_back(model::read_run(found.runs[i]).solution);
  return model::fields_of(std::move(solutions));
}

}  // namespace knothe::offline
