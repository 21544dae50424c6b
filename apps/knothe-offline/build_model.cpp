#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/knothe-offline/commands.hpp"
#include "apps/knothe-offline/model_study.hpp"
#include "apps/knothe-offline/problem.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/mechanics/distributed/ranks.hpp"
#include "knothe/mechanics/full_order/snapshot_runs.hpp"
#include "knothe/mechanics/latin/latin_model.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/grid/grid_refinement.hpp"
#include "knothe/reduction/grid/grid_solutions.hpp"
#include "knothe/reduction/grid/sparse_grid.hpp"
#include "knothe/reduction/model/truncation_error.hpp"
#include "knothe/reduction/observe/crack_modes.hpp"
#include "knothe/reduction/observe/observed_model.hpp"

namespace knothe::offline_commands {
namespace {

using Json = nlohmann::ordered_json;

void report_runs(const mechanics::SnapshotRuns& runs, bool json) {
  std::size_t resumed = 0;
  for (const mechanics::RunSummary& run : runs.runs) {
    resumed += run.resumed ? 1 : 0;
    if (json) {
      fmt::print("{}\n", files::json_line({{"run", run.parameters},
                                           {"resumed", run.resumed},
                                           {"newton_iterations", run.newton_iterations},
                                           {"secant_iterations", run.secant_iterations},
                                           {"cpu_seconds", run.cpu_seconds},
                                           {"steps_without_equilibrium", run.steps_without_equilibrium}}));
    }
    if (!run.steps_without_equilibrium.empty()) {
      fmt::print(
          stderr,
          "knothe: warning: at parameters ({:g}) steps {} are not in equilibrium to 1e-8; see the output "
          "equilibrium_residual of the model\n",
          fmt::join(run.parameters, ", "), fmt::join(run.steps_without_equilibrium, ", "));
    }
  }
  if (!json) fmt::print("{} full-order runs, {} of them kept from before\n", runs.runs.size(), resumed);
}

void report_latin(const mechanics::LatinModel& latin, bool json) {
  const mechanics::LatinSolution& solution = latin.solution;
  for (const mechanics::LatinIteration& it : solution.history) {
    if (json) {
      fmt::print("{}\n", files::json_line({{"first_step", it.first_step},
                                           {"last_step", it.last_step},
                                           {"round", it.round},
                                           {"working_modes", it.working_modes},
                                           {"space_modes", it.archived_modes},
                                           {"points", it.lanes},
                                           {"residual", it.residual},
                                           {"correction_m", it.correction},
                                           {"indicator", it.indicator},
                                           {"cpu_seconds", it.cpu_seconds}}));
    }
  }
  for (const auto& [point, windows] : mechanics::inaccurate_points(solution)) {
    fmt::print(stderr,
               "knothe: warning: at parameters ({:g}) {} window(s) of steps were left before they were "
               "accurate; see "
               "the output equilibrium_residual of the model\n",
               fmt::join(latin.grid.snapshots.parameters_at(point), ", "), windows);
  }
  if (!json) {
    fmt::print("LATIN-PGD: {} grid points, {} space modes, {} global stages, {:.1f} s of CPU time\n",
               latin.grid.snapshots.grid_size(), solution.space.cols(), solution.history.size(),
               solution.cpu_seconds);
  }
}

/// LATIN-PGD in the fully separated form.
reduction::GridSolutions solve_separated(const BuildArguments& arguments,
                                         const project::OfflineOptions& options,
                                         const mechanics::BeamProblem& problem,
                                         const std::vector<reduction::Axis>& axes) {
  mechanics::SeparatedOptions separated;
  if (options.latin_accuracy) separated.accuracy = *options.latin_accuracy;
  separated.window = options.latin_window;
  separated.most_terms = options.latin_terms;
  separated.threads = static_cast<std::size_t>(options.processes);
  separated.quiet = false;
  mechanics::LatinModel model = mechanics::solve_separated_grid(
      problem, axes, separated, arguments.output + ".parts", options.latin_start);
  for (const mechanics::SeparatedIteration& it : model.separated) {
    if (arguments.json)
      fmt::print("{}\n", files::json_line({{"steps", it.steps},
                                           {"round", it.round},
                                           {"terms", it.terms},
                                           {"space_modes", it.space_modes},
                                           {"energy_error", it.energy_error},
                                           {"residual", it.residual},
                                           {"correction_m", it.correction},
                                           {"indicator", it.indicator},
                                           {"relaxation", it.relaxation},
                                           {"cpu_seconds", it.cpu_seconds}}));
  }
  const auto terms = model.grid.terms ? model.grid.terms->time.cols() : 0;
  if (!mechanics::inaccurate_points(model.solution).empty())
    fmt::print(stderr,
               "knothe: warning: with {} terms out-of-balance forces are left that are worth {:.3g} µm "
               "([offline.latin] accuracy asks for {:.3g} µm): {}\n",
               terms, 1e6 * model.separated.back().correction, 1e6 * separated.accuracy,
               terms < separated.most_terms
                   ? "more terms gain nothing; take the joint form (leave separation away)"
                   : fmt::format("raise [offline.latin] terms ({}), or take the joint form (leave separation "
                                 "away)",
                                 separated.most_terms));
  if (!arguments.json)
    fmt::print(
        "LATIN-PGD, fully separated: {} grid points, {} terms, {} global stages, out-of-balance forces worth "
        "{:.2g} µm at most, {:.1f} s of CPU time\n",
        model.grid.snapshots.grid_size(), terms, model.separated.size(),
        model.separated.empty() ? 0.0 : 1e6 * model.separated.back().correction, model.solution.cpu_seconds);
  return std::move(model.grid);
}

project::OfflineMethod method_of(const BuildArguments& arguments, const project::OfflineOptions& options) {
  return from_text<project::OfflineMethod>(arguments.method).value_or(options.method);
}

/// The solution at all points of the grid, by the method that is asked for.
reduction::GridSolutions solve_grid(const BuildArguments& arguments, const project::OfflineOptions& options,
                                    const mechanics::BeamProblem& problem,
                                    const std::vector<reduction::Axis>& axes, int sparse_level) {
  if (method_of(arguments, options) == project::OfflineMethod::latin) {
    if (options.latin_full) return solve_separated(arguments, options, problem, axes);
    mechanics::LatinOptions latin;
    if (options.latin_accuracy) latin.accuracy = *options.latin_accuracy;
    latin.window = options.latin_window;
    latin.threads = static_cast<std::size_t>(options.processes);
    latin.quiet = false;
    mechanics::LatinModel model =
        mechanics::solve_latin_grid(problem, axes, latin, arguments.output + ".parts", options.latin_start);
    report_latin(model, arguments.json);
    return std::move(model.grid);
  }
  mechanics::SnapshotGrid grid;
  grid.axes = axes;
  grid.sparse_level = sparse_level;
  grid.parts_folder = arguments.output + ".parts";
  grid.processes = options.processes;
  const bool first = mechanics::Ranks::of_this_job().rank == 0;
  grid.quiet = !first;
  mechanics::SnapshotRuns runs = mechanics::run_snapshots(problem, grid);
  if (first) report_runs(runs, arguments.json);
  return {
      .snapshots = std::move(runs.snapshots), .basis = {}, .basis_dofs = {}, .basis_mesh = {}, .terms = {}};
}

/// Full-order solutions at four points that are in no grid, to judge interpolation as well as compression.
std::vector<reduction::OffGridSolution> off_grid_runs(const mechanics::BeamProblem& problem,
                                                      const std::vector<reduction::Axis>& axes) {
  constexpr int k_points = 4;
  constexpr std::uint64_t k_seed = 271;  // not that of `model verify`, whose points must be new
  mechanics::FullOrderModel model = mechanics::make_full_order_model(problem);
  std::vector<reduction::OffGridSolution> solutions;
  Progress progress("off-grid runs", k_points);
  for (const std::vector<double>& point : points_in_box(axes, k_points, k_seed)) {
    solutions.push_back({point, mechanics::run_at(model, problem, axes, point).displacement});
    progress.advance_to(solutions.size());
  }
  return solutions;
}

/// Largest error on the observed dofs of splines through the uncompressed snapshots, m.
double interpolation_error(const reduction::Snapshots& snapshots, const std::vector<std::size_t>& dofs,
                           const std::vector<reduction::OffGridSolution>& off_grid) {
  reduction::Dofs seen;
  for (const std::size_t dof : dofs) {
    seen.add(snapshots.dofs.point(dof), snapshots.dofs.components[dof]);
  }
  const reduction::ObservedModel model = reduction::observe_snapshots(snapshots, seen);
  double largest = 0;
  for (const reduction::OffGridSolution& solution : off_grid) {
    const auto d = static_cast<Eigen::Index>(solution.parameters.size());
    const Eigen::VectorXd p = Eigen::Map<const Eigen::VectorXd>(solution.parameters.data(), d);
    for (std::size_t step = 0; step < snapshots.time.size(); ++step) {
      const Eigen::VectorXd y = model.predict(p, step);
      for (std::size_t i = 0; i < dofs.size(); ++i)
        largest = std::max(largest, std::abs(y[static_cast<Eigen::Index>(i)] -
                                             solution.values[step * snapshots.dof_count() + dofs[i]]));
    }
  }
  return largest;
}

/// Full-order runs of a grid.
std::size_t runs_of(const std::vector<reduction::Axis>& axes, int sparse_level) {
  return reduction::sparse_grid(axes, sparse_level < 0 ? reduction::finest_level(axes) : sparse_level)
      .points.size();
}

reduction::GridSolutions too_few_runs(const project::OfflineOptions& options, double error,
                                      std::size_t points, reduction::GridSolutions solutions) {
  fmt::print(stderr,
             "knothe: warning: grid_error {:g} m is not met ({:g} m), and a finer grid would have {} points, "
             "more than [offline.adaptive] runs = {}\n",
             *options.adaptive_grid_error, error, points, options.adaptive_runs);
  return solutions;
}

/// Solves the grid, and finer ones until `grid_error` is met ([offline.adaptive]); old runs are kept.
reduction::GridSolutions solve_adaptive_grid(const BuildArguments& arguments, const project::Project& project,
                                             const mechanics::BeamProblem& problem,
                                             std::vector<reduction::Axis> axes,
                                             const std::vector<reduction::OffGridSolution>& off_grid) {
  const project::OfflineOptions& options = *project.offline;
  int level = options.sparse_level.value_or(-1);
  while (true) {
    reduction::GridSolutions solutions = solve_grid(arguments, options, problem, axes, level);
    if (!options.adaptive_grid_error) return solutions;
    const reduction::Snapshots& snapshots = solutions.snapshots;
    const std::vector<std::size_t> dofs = judged_dofs(project, snapshots.dofs);
    const double error = interpolation_error(snapshots, dofs, off_grid);
    fmt::print(stderr, "parameter grid of {} points: off the grid at most {:.3f} µm on the observed dofs\n",
               snapshots.grid_size(), 1e6 * error);
    if (error <= *options.adaptive_grid_error) return solutions;
    if (level >= 0 && level < reduction::finest_level(axes)) {
      // The runs of the lower level stay.
      if (runs_of(axes, level + 1) > static_cast<std::size_t>(options.adaptive_runs))
        return too_few_runs(options, error, runs_of(axes, level + 1), std::move(solutions));
      ++level;
      continue;
    }
    const auto weak = reduction::weakest_node(snapshots, dofs);
    if (!weak)
      throw ProjectError(
          "[offline.adaptive]: grid_error needs an axis of at least three nodes to begin with");
    axes = reduction::refined(axes, *weak);
    if (level >= 0) level = reduction::finest_level(axes);
    const std::size_t points = runs_of(axes, -1);
    if (points > static_cast<std::size_t>(options.adaptive_runs))
      return too_few_runs(options, error, points, std::move(solutions));
  }
}

}  // namespace

int build_model(const BuildArguments& arguments) {
  const project::Project project = project::read_project(arguments.project);
  const mechanics::BeamProblem problem = beam_problem(project);
  const project::OfflineOptions& options = *project.offline;

  const std::vector<reduction::Axis> axes = parameter_axes(project);
  const bool is_latin = method_of(arguments, options) == project::OfflineMethod::latin;
  if (options.adaptive_grid_error && is_latin)
    throw ProjectError("\"grid_error\" adds full-order runs: it goes with method = \"snapshots\"");
  check_adaptive(project, axes);
  const bool is_first = mechanics::Ranks::of_this_job().rank == 0;
  if (is_latin && !is_first) {  // LATIN has all points at once: the first rank's threads do it
    mechanics::Ranks::finish();
    return 0;
  }
  // The off-grid runs judge an adaptive grid; without one they come last, when the grid's runs are safe.
  std::vector<reduction::OffGridSolution> off_grid;
  if (options.adaptive_grid_error) off_grid = off_grid_runs(problem, axes);
  const reduction::GridSolutions solutions = solve_adaptive_grid(arguments, project, problem, axes, off_grid);

  // In an MPI job all ranks have computed runs and now hold the same snapshots; the first one goes on.
  if (!is_first) {
    mechanics::Ranks::finish();
    return 0;
  }

  reduction::CompressionOptions compression;
  compression.form = options.form;
  compression.modes = options.adaptive_error || options.adaptive_shift
                          ? choose_modes(project, solutions, compression.form)
                          : static_cast<std::size_t>(options.modes);
  compression.quiet = false;
  reduction::ModelContents model = reduction::compress(solutions, compression);
  if (options.crack_lengths > 0 && problem.gmsh_file.empty()) {
    mechanics::CrackOptions crack;
    crack.count = options.crack_lengths;
    const mechanics::CrackTable table = mechanics::crack_table(problem, crack, solutions.dofs());
    model.crack = reduction::crack_modes(table.lengths, table.values);
  }
  model.project = project.text;
  if (off_grid.empty()) off_grid = off_grid_runs(problem, axes);
  reduction::write_model(model, reduction::truncation_error(model, solutions, off_grid), arguments.output);

  report_study(study_models(project, solutions, off_grid), arguments.json);
  if (arguments.json) {
    fmt::print("{}\n", files::json_line({{"done", true},
                                         {"model", arguments.output},
                                         {"relative_error", model.relative_error},
                                         {"max_error_m", model.max_error_m}}));
  } else {
    fmt::print("{}: {} form, {} modes, error on the grid {:.2g} (relative), at most {:.3g} µm on any dof\n",
               arguments.output, to_text(options.form), model.parameter_modes, model.relative_error,
               model.max_error_m * 1e6);
  }
  mechanics::Ranks::finish();
  return 0;
}

}  // namespace knothe::offline_commands
