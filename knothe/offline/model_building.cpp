#include "knothe/offline/model_building.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/mechanics/distributed/ranks.hpp"
#include "knothe/offline/adaptive_runs.hpp"
#include "knothe/offline/grid_solving.hpp"
#include "knothe/offline/model_study.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/reduction/compress/quantity_scales.hpp"
#include "knothe/reduction/observe/crack_modes.hpp"

namespace knothe::offline {
namespace {

/// Crack solutions of the structured beam, for forecasts of its crack's length.
reduction::CrackSolutions crack_solutions(const project::Project& project, const reduction::Dofs& dofs) {
  const project::OfflineOptions& options = *project.offline;
  if (!options.is_beam()) return {};
  const mechanics::BeamProblem problem = beam_problem(project);
  // They belong to an imposed displacement, which along another output depends on the parameters.
  if (options.crack_lengths == 0 || !problem.gmsh_file.empty() || !options.time.output.empty()) return {};
  const mechanics::CrackTable table = mechanics::crack_table(problem, {.count = options.crack_lengths}, dofs);
  return reduction::crack_modes(table.lengths, table.values);
}

reduction::ModelContents compressed(const project::Project& project,
                                    const reduction::GridSolutions& solutions) {
  const project::OfflineOptions& options = *project.offline;
  reduction::CompressionOptions compression;
  compression.form = options.form;
  compression.modes = options.adaptive_error || options.adaptive_shift
                          ? choose_modes(project, solutions, compression.form)
                          : static_cast<std::size_t>(options.modes);
  compression.quiet = false;
  reduction::ModelContents model = reduction::compress(solutions, compression);
  model.crack = crack_solutions(project, solutions.dofs());
  model.project = project.text;
  return model;
}

struct SolvedGrid {
  reduction::GridSolutions solutions;
  std::vector<reduction::OffGridSolution> off_grid;  ///< where they were needed already
};

SolvedGrid solve(const project::Project& project, simulator::Simulator& solver, const std::string& parts,
                 const files::CommandOutput& output) {
  const project::OfflineOptions& options = *project.offline;
  if (options.method == project::OfflineMethod::latin) return {solve_latin(project, parts, output), {}};
  if (options.adaptive_grid_shift) {
    AdaptiveSolutions chosen = solve_adaptive_grid(project, solver, parts, output);
    return {std::move(chosen.solutions), std::move(chosen.held_out)};
  }
  // The off-grid runs judge an adaptive grid; without one they come last, when the grid's runs are safe.
  std::vector<reduction::OffGridSolution> off_grid;
  if (options.adaptive_grid_error) off_grid = solve_off_grid(solver, parameter_axes(project));
  reduction::GridSolutions solutions = solve_project_grid(project, solver, parts, off_grid, output);
  return {std::move(solutions), std::move(off_grid)};
}

void check_method(const project::OfflineOptions& options) {
  if (options.method != project::OfflineMethod::latin) return;
  if (options.adaptive_grid_error || options.adaptive_grid_shift)
    throw ProjectError(fmt::format("\"{}\" adds full-order runs: it needs method = \"snapshots\"",
                                   options.adaptive_grid_shift ? "grid_shift" : "grid_error"));
  if (!options.is_beam())
    throw ProjectError("LATIN-PGD solves for the built-in beam: another solver needs method = \"snapshots\"");
}

/// The finished runs of a grid, once the model has been made of them. What else is in the folder stays.
void remove_finished_runs(const std::string& parts) {
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(parts, ignored))
    if (entry.path().filename().string().starts_with("run-")) std::filesystem::remove(entry.path(), ignored);
  std::filesystem::remove(parts, ignored);  // unless something is left
}

void build(const BuildOptions& build, const files::CommandOutput& output) {
  project::Project project = project::read_project(build.project);
  const std::vector<reduction::Axis> axes = parameter_axes(project);
  project::OfflineOptions& options = *project.offline;
  options.method = from_text<project::OfflineMethod>(build.method).value_or(options.method);
  check_method(options);
  check_adaptive(project, axes);
  check_grid_shift(project, axes);
  const bool is_first = mechanics::Ranks::of_this_job().rank == 0;
  // LATIN has all points at once: the first rank's threads do it.
  if (options.method == project::OfflineMethod::latin && !is_first) return;
  const auto solver = project_simulator(project, axes);
  const std::string parts = build.model + ".parts";
  auto [solutions, off_grid] = solve(project, *solver, parts, output);
  // In an MPI job all ranks have computed runs and now hold the same snapshots; the first one goes on.
  if (!is_first) return;
  reduction::ModelContents model = compressed(project, solutions);
  if (off_grid.empty()) off_grid = solve_off_grid(*solver, axes);
  const reduction::ModelError between = reduction::off_grid_error(model, off_grid);
  model.off_grid = {std::max(between.relative, between.plain_relative), between.max, "full-order solutions"};
  reduction::write_model(model, reduction::truncation_error(model, solutions, off_grid), build.model);
  if (build.study) study_models(project, solutions, off_grid, output);
  remove_finished_runs(parts);
  output.line({{"done", true},
               {"model", build.model},
               {"relative_error", model.relative_error},
               {"max_error_m", model.max_error_m}},
              fmt::format("{}: {} form, {} modes, error on the grid {:.2g} (relative), {}", build.model,
                          to_text(options.form), model.parameter_modes, model.relative_error,
                          reduction::largest_error(model.max_error_m, model.quantities)));
}

}  // namespace

void build_model(const BuildOptions& options, const files::CommandOutput& output) {
  build(options, output);
  mechanics::Ranks::finish();
}

}  // namespace knothe::offline
