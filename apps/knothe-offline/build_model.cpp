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
#include "knothe/mechanics/latin_model.hpp"
#include "knothe/mechanics/snapshot_runs.hpp"
#include "knothe/numerics/sobol.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/compression.hpp"
#include "knothe/reduction/crack_modes.hpp"

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
               fmt::join(latin.snapshots.parameters_at(point), ", "), windows);
  }
  if (!json) {
    fmt::print("LATIN-PGD: {} grid points, {} space modes, {} global stages, {:.1f} s of CPU time\n",
               latin.snapshots.grid_size(), solution.space.cols(), solution.history.size(),
               solution.cpu_seconds);
  }
}

/// The solution at all points of the grid, by the method that is asked for.
reduction::Snapshots solve_grid(const BuildArguments& arguments, const project::OfflineOptions& options,
                                const mechanics::BeamProblem& problem,
                                const std::vector<reduction::Axis>& axes) {
  const std::string& method = arguments.method.empty() ? options.method : arguments.method;
  if (method == "latin") {
    mechanics::LatinOptions latin;
    latin.accuracy = options.latin_accuracy;
    latin.window = options.latin_window;
    latin.threads = static_cast<std::size_t>(options.processes);
    latin.quiet = false;
    mechanics::LatinModel model = mechanics::solve_latin_grid(problem, axes, latin);
    report_latin(model, arguments.json);
    return std::move(model.snapshots);
  }
  mechanics::SnapshotGrid grid;
  grid.axes = axes;
  grid.parts_folder = arguments.output + ".parts";
  grid.processes = options.processes;
  mechanics::SnapshotRuns runs = mechanics::run_snapshots(problem, grid);
  report_runs(runs, arguments.json);
  return std::move(runs.snapshots);
}

/// Full-order solutions at four points that are in no grid, to judge interpolation as well as compression.
std::vector<reduction::OffGridSolution> off_grid_runs(const mechanics::BeamProblem& problem,
                                                      const std::vector<reduction::Axis>& axes) {
  constexpr int k_points = 4;
  constexpr std::uint64_t k_seed = 1;
  mechanics::FullOrderModel model = mechanics::make_full_order_model(problem);
  const Eigen::MatrixXd unit =
      numerics::sobol_points(k_points, static_cast<Eigen::Index>(axes.size()), k_seed);
  std::vector<reduction::OffGridSolution> solutions;
  Progress progress("off-grid runs", k_points);
  for (int i = 0; i < k_points; ++i) {
    reduction::OffGridSolution solution;
    for (std::size_t k = 0; k < axes.size(); ++k) {
      const std::vector<double>& nodes = axes[k].nodes;
      solution.parameters.push_back(nodes.front() +
                                    unit(i, static_cast<Eigen::Index>(k)) * (nodes.back() - nodes.front()));
    }
    solution.values =
        model.run(mechanics::damage_parameters(problem, axes, solution.parameters)).displacement;
    solutions.push_back(std::move(solution));
    progress.advance_to(static_cast<std::size_t>(i) + 1);
  }
  return solutions;
}

}  // namespace

int build_model(const BuildArguments& arguments) {
  const project::Project project = project::read_project(arguments.project);
  const mechanics::BeamProblem problem = beam_problem(project);
  const project::OfflineOptions& options = *project.offline;

  const std::vector<reduction::Axis> axes = parameter_axes(project);
  const reduction::Snapshots snapshots = solve_grid(arguments, options, problem, axes);

  reduction::CompressionOptions compression;
  compression.form = options.form == "canonical" ? reduction::Form::canonical : reduction::Form::tree;
  compression.modes = static_cast<std::size_t>(options.modes);
  compression.quiet = false;
  reduction::ModelContents model = reduction::compress(snapshots, compression);
  if (options.crack_lengths > 0 && problem.gmsh_file.empty()) {
    mechanics::CrackOptions crack;
    crack.count = options.crack_lengths;
    const mechanics::CrackTable table = mechanics::crack_table(problem, crack, snapshots.dofs);
    model.crack = reduction::crack_modes(table.lengths, table.values);
  }
  model.project = project.text;
  reduction::write_model(model, arguments.output);

  report_study(study_models(project, snapshots, off_grid_runs(problem, axes)), arguments.json);
  if (arguments.json) {
    fmt::print("{}\n", files::json_line({{"done", true},
                                         {"model", arguments.output},
                                         {"relative_error", model.relative_error},
                                         {"max_error_m", model.max_error_m}}));
  } else {
    fmt::print("{}: {} form, {} modes, error on the grid {:.2g} (relative), at most {:.3g} µm on any dof\n",
               arguments.output, options.form, model.parameter_modes, model.relative_error,
               model.max_error_m * 1e6);
  }
  return 0;
}

}  // namespace knothe::offline_commands
