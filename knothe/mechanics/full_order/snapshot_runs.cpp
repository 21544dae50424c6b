#include "knothe/mechanics/full_order/snapshot_runs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/mechanics/distributed/ranks.hpp"
#include "knothe/mechanics/full_order/child_processes.hpp"
#include "knothe/mechanics/full_order/run_key.hpp"
#include "knothe/mechanics/law/regularisation.hpp"
#include "knothe/reduction/grid/sparse_grid.hpp"

namespace knothe::mechanics {
namespace {

struct Part {
  std::size_t point = 0;  ///< of the tensor grid
  std::string key, path;
  std::vector<double> parameters;  ///< dimensionless
  BeamProblem problem;             ///< at these parameters
};

void check_axes(const SnapshotGrid& grid) {
  if (grid.axes.empty()) throw ProjectError("the offline phase needs at least one parameter axis (Y0 or Ad)");
  for (const auto& axis : grid.axes) {
    if (axis.nodes.size() < 2)
      throw ProjectError(fmt::format("parameter {}: its axis has {} node(s); at least 2 are needed",
                                     axis.name, axis.nodes.size()));
    for (std::size_t i = 1; i < axis.nodes.size(); ++i)
      if (!(axis.nodes[i] > axis.nodes[i - 1]))
        throw ProjectError(fmt::format("parameter {}: the axis must increase, but node {} is {} after {}",
                                       axis.name, i, axis.nodes[i], axis.nodes[i - 1]));
    for (const auto& other : grid.axes)
      if (&other != &axis && other.name == axis.name)
        throw ProjectError(fmt::format("parameter {} has two axes", axis.name));
  }
  if (grid.processes < 1)
    throw ProjectError(fmt::format("processes is {}; it must be at least 1", grid.processes));
  if (grid.parts_folder.empty()) throw ProjectError("no folder is given for the finished runs");
}

std::string describe_point(const SnapshotGrid& grid, const Part& part) {
  std::string text;
  for (std::size_t i = 0; i < grid.axes.size(); ++i)
    text += fmt::format("{}{} = {:.6g}", i == 0 ? "" : ", ", grid.axes[i].name, part.parameters[i]);
  return text;
}

void write_part(const Part& part, const FullOrderResult& result) {
  files::write_atomically(part.path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    const std::size_t steps = result.steps.size();
    file.write("/displacement", result.displacement, {steps, result.displacement.size() / steps},
               {"m", "displacement"});
    std::vector<double> records;
    for (const auto& step : result.steps)
      for (const double value : {step.reaction_force, step.crack_mouth_opening, step.imposed_displacement,
                                 step.residual, step.equilibrium ? 1.0 : 0.0})
        records.push_back(value);
    file.write("/records", records, {steps, 5},
               {"1",
                "reaction force (N), crack-mouth opening (m), imposed displacement (m), residual (1), in "
                "equilibrium"});
    file.text_attribute("/", "key", part.key);
    file.number_attribute("/", "newton_iterations", result.newton_iterations());
    file.number_attribute("/", "secant_iterations", result.secant_iterations());
    file.number_attribute("/", "cpu_seconds", result.cpu_seconds);
    file.close();
  });
}

/// Whether the part is there, readable, and of this very run.
bool part_is_there(const Part& part) {
  if (!std::filesystem::exists(part.path)) return false;
  try {
    const files::Hdf5Reader file(part.path);
    return file.has("/displacement") && file.has("/records") && file.text_attribute("/", "key") == part.key;
  } catch (const DataError&) {
    return false;  // computed again and replaced
  }
}

/// Reads a part into its place of the snapshots.
void read_part(const Part& part, std::size_t steps, std::size_t dofs, SnapshotRuns& runs, RunSummary& run) {
  const files::Hdf5Reader file(part.path);
  const auto displacement = file.read("/displacement", {steps, dofs});
  std::copy(displacement.begin(), displacement.end(),
            runs.snapshots.values.begin() + static_cast<std::ptrdiff_t>(part.point * steps * dofs));
  const auto records = file.read("/records", {steps, 5});
  for (std::size_t step = 0; step < steps; ++step) {
    for (std::size_t k = 0; k < 4; ++k)
      runs.snapshots.outputs[k].values[part.point * steps + step] = records[5 * step + k];
    if (records[5 * step + 4] == 0) run.steps_without_equilibrium.push_back(static_cast<int>(step));
  }
  run.newton_iterations = static_cast<int>(file.number_attribute("/", "newton_iterations"));
  run.secant_iterations = static_cast<int>(file.number_attribute("/", "secant_iterations"));
  run.cpu_seconds = file.number_attribute("/", "cpu_seconds");
}

std::vector<Part> list_parts(const BeamProblem& problem, const SnapshotGrid& grid,
                             const reduction::Snapshots& snapshots, const std::vector<std::size_t>& points) {
  std::vector<Part> parts(points.size());
  for (std::size_t i = 0; i < parts.size(); ++i) {
    parts[i].point = points[i];
    parts[i].parameters = snapshots.parameters_at(points[i]);
    parts[i].problem = problem_at(problem, grid.axes, parts[i].parameters);
    parts[i].key = run_key(parts[i].problem);
    parts[i].path =
        (std::filesystem::path(grid.parts_folder) / fmt::format("run-{:016x}.h5", fnv1a(parts[i].key)))
            .string();
  }
  return parts;
}

/// The runs `missing` of one elastic body; `there` are done before.
void compute(FullOrderModel& model, const SnapshotGrid& grid, const std::vector<Part>& parts,
             const std::vector<std::size_t>& missing, std::size_t there, Progress& progress) {
  const auto total = parts.size();
  const auto kept = [&](std::size_t done) {
    return fmt::format("{} of {} runs are kept in {}; the same command goes on from there", done, total,
                       grid.parts_folder);
  };
  const auto count_parts = [&] {
    return kept(static_cast<std::size_t>(std::count_if(parts.begin(), parts.end(), part_is_there)));
  };
  try {
    run_in_processes(
        static_cast<int>(missing.size()), grid.processes,
        [&](int job) {
          const Part& part = parts[missing[static_cast<std::size_t>(job)]];
          write_part(part, model.run(part.problem.reference));
        },
        [&](int done) { progress.advance_to(there + static_cast<std::size_t>(done)); }, count_parts);
  } catch (const JobFailure& failure) {
    const std::size_t run = missing[static_cast<std::size_t>(failure.job)];
    if (failure.exit_status == static_cast<int>(ExitStatus::interrupted))
      throw Interrupted("interrupted; " + count_parts());
    const std::string what = fmt::format("full-order run {} of {} ({}) failed: {}; {}", run + 1, total,
                                         describe_point(grid, parts[run]), failure.message, count_parts());
    if (failure.exit_status == static_cast<int>(ExitStatus::io)) throw IoError(what);
    throw NumericalError(what +
                         " (killed by signal 9 usually means that memory ran out: use fewer processes)");
  }
}

/// Body by body: a model is made here and not in the forked processes, where deal.II's threads (TBB) do not
/// survive.
void compute_by_body(const BeamProblem& problem, FullOrderModel& base, const SnapshotGrid& grid,
                     const std::vector<Part>& parts, std::vector<std::size_t> missing) {
  std::size_t there = parts.size() - missing.size();
  Progress progress("full-order runs", parts.size(), grid.quiet);
  progress.advance_to(there);
  while (!missing.empty()) {
    const BeamProblem& body = parts[missing.front()].problem;
    const auto others = std::stable_partition(
        missing.begin(), missing.end(), [&](std::size_t i) { return same_body(parts[i].problem, body); });
    const std::vector<std::size_t> now(missing.begin(), others);
    missing.erase(missing.begin(), others);
    if (same_body(body, problem)) {
      compute(base, grid, parts, now, there, progress);
    } else {
      FullOrderModel model = make_full_order_model(body);
      compute(model, grid, parts, now, there, progress);
    }
    there += now.size();
  }
}

}  // namespace

SnapshotRuns run_snapshots(const BeamProblem& problem, const SnapshotGrid& grid) {
  check_axes(grid);
  FullOrderModel model = make_full_order_model(problem);
  const auto steps = static_cast<std::size_t>(problem.solver.steps);
  const auto dofs = static_cast<std::size_t>(model.structure().dof_count());

  SnapshotRuns runs;
  runs.snapshots = as_snapshots(problem, model.structure(), {});
  runs.snapshots.axes = grid.axes;
  const reduction::SparseGrid plan = reduction::sparse_grid(
      grid.axes, grid.sparse_level < 0 ? reduction::finest_level(grid.axes) : grid.sparse_level);
  const std::vector<Part> parts = list_parts(problem, grid, runs.snapshots, plan.points);
  // All points before the first run: a box in which the law has no solution is told at once.
  const std::vector<double> ratios =
      band_ratios(model.structure().mesh(), model.structure().elements(), problem.solver.regularisation);
  for (const Part& part : parts)
    check_band(model.structure().mesh(), problem.solver.regularisation, ratios, part.problem.reference);
  std::error_code failed;
  std::filesystem::create_directories(grid.parts_folder, failed);
  if (failed)
    throw IoError(
        fmt::format("cannot make the folder {} for finished runs: {}", grid.parts_folder, failed.message()));

  runs.runs.resize(parts.size());
  std::vector<std::size_t> missing;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    runs.runs[i].parameters = parts[i].parameters;
    runs.runs[i].resumed = part_is_there(parts[i]);
    if (!runs.runs[i].resumed) missing.push_back(i);
  }
  const Ranks ranks = Ranks::of_this_job();
  ranks.wait();  // all have seen the same parts
  if (ranks.size > 1) {
    std::vector<std::size_t> share;
    for (std::size_t k = 0; k < missing.size(); ++k)
      if (static_cast<int>(k % static_cast<std::size_t>(ranks.size)) == ranks.rank)
        share.push_back(missing[k]);
    missing = std::move(share);
  }
  if (!missing.empty()) compute_by_body(problem, model, grid, parts, missing);
  ranks.wait();

  const std::size_t grid_size = runs.snapshots.grid_size();
  runs.snapshots.values.resize(grid_size * steps * dofs);
  for (auto& output : runs.snapshots.outputs) output.values.resize(grid_size * steps);
  for (std::size_t i = 0; i < parts.size(); ++i) read_part(parts[i], steps, dofs, runs, runs.runs[i]);
  reduction::interpolate_others(plan, runs.snapshots);
  reduction::validate(runs.snapshots, "full-order runs");
  return runs;
}

}  // namespace knothe::mechanics
