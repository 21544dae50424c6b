#include "knothe/offline/model_building.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <utility>

#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/model/compress/quantity_scales.hpp"
#include "knothe/model/observe/crack_modes.hpp"
#include "knothe/offline/adaptive_runs.hpp"
#include "knothe/offline/distributed/ranks.hpp"
#include "knothe/offline/grid_solving.hpp"
#include "knothe/offline/model_study.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/offline/similar_runs.hpp"

namespace knothe::offline {
namespace {

/// Crack solutions of the structured beam, for forecasts of its crack's length.
model::CrackSolutions crack_solutions(const project::Project& project, const model::Dofs& dofs) {
  const project::OfflineOptions& options = *project.offline;
  if (!options.is_beam()) return {};
  const BeamProblem problem = beam_problem(project);
  // They belong to an imposed displacement, which along another output depends on the parameters.
  if (options.crack_lengths == 0 || !problem.gmsh_file.empty() || !options.time.output.empty()) return {};
  const CrackTable table = crack_table(problem, {.count = options.crack_lengths}, dofs);
  return model::crack_modes(table.lengths, table.values);
}

model::ModelContents compressed(const project::Project& project, const model::GridSolutions& solutions) {
  const project::OfflineOptions& options = *project.offline;
  model::CompressionOptions compression;
  compression.form = options.form;
  compression.modes = options.adaptive_error || options.adaptive_shift
                          ? choose_modes(project, solutions, compression.form)
                          : static_cast<std::size_t>(options.modes);
  compression.quiet = false;
  model::ModelContents model = model::compress(solutions, compression);
  model.crack = crack_solutions(project, solutions.dofs());
  model.project = project.text;
  return model;
}

/// `solver`: for what is off the grid.
SolvedGrid solve(const project::Project& project, model::Simulator& solver, const std::string& parts,
                 const files::CommandOutput& output) {
  const project::OfflineOptions& options = *project.offline;
  if (options.method == project::OfflineMethod::latin) return {solve_latin(project, parts, output), {}, 0};
  if (options.adaptive_grid_shift) return solve_adaptive_grid(project, solver, parts, output);
  SolvedGrid solved = options.scaling ? solve_similar_grid(project, parts, output)
                                      : solve_project_grid(project, solver, parts, output);
  if (!solved.off_grid.empty()) return solved;
  model::RunGrid grid = run_grid_of(project, parts);
  grid.axes = solved.solutions.snapshots.axes;
  solved.off_grid = solve_off_grid(project, solver, std::move(grid), share_of_ranks());
  return solved;
}

/// "I/N" → I, N.
model::JobShare parse_share(const std::string& text) {
  model::JobShare share;
  int end = 0;
  if (std::sscanf(text.c_str(), "%d/%d%n", &share.rank, &share.size, &end) != 2 || end != std::ssize(text) ||
      share.rank < 0 || share.rank >= share.size)
    throw UsageError(fmt::format(
        "--share {}: it is I/N, share I of N, counted from 0: 0/4, 1/4, 2/4 and 3/4 are all runs", text));
  return share;
}

/// The runs of one share alone: which these are depends on the project only, not on what is there.
void make_share(const project::Project& project, model::Simulator& solver, const BuildOptions& options,
                const std::string& parts, const files::CommandOutput& output) {
  const model::JobShare share = parse_share(options.share);
  if (project.offline->method == project::OfflineMethod::latin || project.offline->adaptive_grid_error ||
      project.offline->adaptive_grid_shift)
    throw UsageError(
        "--share: the runs must be known beforehand, those of a grid; LATIN-PGD, grid_error and grid_shift "
        "take MPI (mpirun, srun)");
  const model::RunGrid grid = run_grid_of(project, parts);
  std::size_t computed = 0, own = 0, all = 0;
  const auto make = [&](model::Simulator& simulator, const std::vector<std::vector<double>>& points) {
    std::vector<std::vector<double>> mine;
    for (const std::vector<double>& point : points)
      if (std::cmp_equal(all++ % share.size, share.rank)) mine.push_back(point);
    own += mine.size();
    if (!mine.empty()) computed += model::run_points(simulator, grid, mine).computed.size();
  };
  if (project.offline->scaling) {
    SimilarRuns runs(project);
    make(runs.solver, runs.similarity.points());
  } else {
    make(solver, points_of(grid));
  }
  make(solver, off_grid_points(project, grid.axes));
  output.line({{"done", true}, {"share", options.share}, {"runs", own}, {"computed", computed}},
              fmt::format("share {}: {} of {} runs ({} reused from an earlier call). After all shares, run "
                          "the same command without --share to make the model",
                          options.share, own, all, own - computed));
}

void check_method(const project::OfflineOptions& options) {
  if (options.method != project::OfflineMethod::latin) return;
  if (options.adaptive_grid_error || options.adaptive_grid_shift)
    throw ProjectError(fmt::format("\"{}\" adds full-order runs: it needs method = \"snapshots\"",
                                   options.adaptive_grid_shift ? "grid_shift" : "grid_error"));
  if (!options.is_beam())
    throw ProjectError("LATIN-PGD solves for the built-in beam: another solver needs method = \"snapshots\"");
}

/// The finished runs of a grid, once the model has been made of them, and what writing of one that was
/// interrupted has left. What else is in the folder stays.
void remove_finished_runs(const std::string& parts) {
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(parts, ignored)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("run-") || name.starts_with(".run-")) std::filesystem::remove(entry.path(), ignored);
  }
  std::filesystem::remove(parts, ignored);  // unless something is left
}

void build(const BuildOptions& build, const files::CommandOutput& output) {
  project::Project project = project::read_project(build.project);
  const std::vector<model::Axis> axes = parameter_axes(project);
  project::OfflineOptions& options = *project.offline;
  options.method = from_text<project::OfflineMethod>(build.method).value_or(options.method);
  check_method(options);
  check_adaptive(project, axes);
  check_grid_shift(project, axes);
  const bool is_first = Ranks::of_this_job().rank == 0;
  // LATIN has all points at once: the first rank's threads do it.
  if (options.method == project::OfflineMethod::latin && !is_first) return;
  const auto solver = project_simulator(project, axes);
  const std::string parts = build.model + ".parts";
  if (!build.share.empty()) return make_share(project, *solver, build, parts, output);
  auto [solutions, off_grid, failed] = solve(project, *solver, parts, output);
  // In an MPI job all ranks have computed runs and now hold the same snapshots; the first one goes on.
  if (!is_first) return;
  model::ModelContents model = compressed(project, solutions);
  if (off_grid.empty()) off_grid = solve_off_grid(project, *solver, run_grid_of(project, parts));
  if (off_grid.empty()) {
    fmt::print(stderr,
               "knothe: warning: all runs off the grid failed: the model's error there is not known\n");
  } else {
    const model::ModelError between = model::off_grid_error_in_scales(
        solutions.snapshots, model, off_grid.size(), [&](std::size_t i) { return off_grid[i]; });
    model.off_grid = {std::max(between.relative, between.plain_relative), between.max,
                      "full-order solutions"};
  }
  model::TruncationError error = model::truncation_error(model, solutions, off_grid);
  if (options.scaling) {
    const Similarity similarity(beam_problem(project), parameter_axes(project), options.scaling_runs);
    error.alike = similarity.exponents();
    // Of points between the same runs.
    if (!error.alike.empty()) error.alike_within = similarity.nodes()[0][1] - similarity.nodes()[0][0];
  }
  model::write_model(model, error, build.model);
  if (build.study) study_models(project, solutions, off_grid, output);
  if (failed == 0)
    remove_finished_runs(parts);
  else
    fmt::print(
        stderr,
        "knothe: warning: the model is made without {} failed run(s); the others are kept in {}: the same "
        "command tries those that failed once more\n",
        failed, parts);
  output.line({{"done", true},
               {"model", build.model},
               {"relative_error", model.relative_error},
               {"max_error_m", model.max_error_m}},
              fmt::format("{}: {} form, {}, error on the grid {:.2g} (relative), {}", build.model,
                          to_text(options.form), counted(model.parameter_modes, "mode"), model.relative_error,
                          model::largest_error(model.max_error_m, model.quantities)));
}

}  // namespace

void build_model(const BuildOptions& options, const files::CommandOutput& output) {
  build(options, output);
  Ranks::finish();
}

}  // namespace knothe::offline
