#include "knothe/simulator/grid_runs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "knothe/base/progress.hpp"
#include "knothe/base/text.hpp"
#include "knothe/reduction/grid/sparse_grid.hpp"

namespace knothe::simulator {
namespace {

void check_axes(const RunGrid& grid) {
  if (grid.axes.empty()) throw ProjectError("the offline phase needs at least one parameter axis");
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

/// The runs of one grid, those that are kept and those that are not.
class Runs {
 public:
  Runs(Simulator& simulator, const RunGrid& grid, std::span<const std::vector<double>> points)
      : simulator_(simulator), grid_(grid) {
    for (const std::vector<double>& point : points) {
      const std::string key = simulator.key(point);
      const std::filesystem::path folder(grid.parts_folder);
      runs_.push_back({point, key, (folder / fmt::format("run-{:016x}.h5", fnv1a(key))).string()});
    }
    for (const reduction::Axis& axis : grid.axes) names_.push_back(axis.name);
    std::error_code failed;
    std::filesystem::create_directories(grid.parts_folder, failed);
    if (failed)
      throw IoError(fmt::format("cannot make the folder {} for finished runs: {}", grid.parts_folder,
                                failed.message()));
  }

  [[nodiscard]] const std::vector<Run>& all() const { return runs_; }

  /// Solves for `missing`, which are some of those that are not there.
  void solve(const std::vector<std::size_t>& missing, std::size_t there) {
    Progress progress("full-order runs", runs_.size(), grid_.quiet);
    progress.advance_to(there);
    std::vector<Run> wanted;
    for (const std::size_t i : missing) wanted.push_back(runs_[i]);
    std::vector<RunFailure> failures;
    try {
      failures = simulator_.solve_to_files(wanted, grid_.processes,
                                           [&](std::size_t done) { progress.advance_to(there + done); });
    } catch (const Interrupted&) {
      throw Interrupted("interrupted; " + kept());
    }
    for (RunFailure& failure : failures) failure.run = missing[failure.run];
    if (!failures.empty()) complain_of(failures);
  }

 private:
  [[nodiscard]] std::string kept() const {
    return fmt::format("{} of {} runs are kept in {}; the same command goes on from there",
                       std::count_if(runs_.begin(), runs_.end(), is_there), runs_.size(), grid_.parts_folder);
  }
  [[nodiscard]] std::string at(std::size_t run) const { return describe(names_, runs_[run].parameters); }

  [[noreturn]] void complain_of(const std::vector<RunFailure>& failures) const {
    constexpr std::size_t k_shown = 20;
    std::string what;
    if (failures.size() == 1) {
      const std::size_t run = failures[0].run;
      what = fmt::format("full-order run {} of {} ({}) failed: {}; {}", run + 1, runs_.size(), at(run),
                         failures[0].message, kept());
    } else {
      what = fmt::format("{} of {} full-order runs failed; {}:", failures.size(), runs_.size(), kept());
      for (std::size_t i = 0; i < std::min(failures.size(), k_shown); ++i)
        what +=
            fmt::format("\n  run {} ({}): {}", failures[i].run + 1, at(failures[i].run), failures[i].message);
      if (failures.size() > k_shown) what += fmt::format("\n  and {} more", failures.size() - k_shown);
    }
    if (failures[0].status == ExitStatus::io) throw IoError(what);
    throw NumericalError(what);
  }

  Simulator& simulator_;
  const RunGrid& grid_;
  std::vector<Run> runs_;
  std::vector<std::string> names_;
};

/// Puts solutions into their places of the grid's snapshots.
class Gathering {
 public:
  /// `frame`: what the solutions share, if it is known; otherwise the first one has it.
  Gathering(std::vector<reduction::Axis> axes, std::optional<reduction::Snapshots> frame) {
    has_frame_ = frame.has_value();
    if (frame) snapshots_ = std::move(*frame);
    snapshots_.axes = std::move(axes);
  }

  void add(std::size_t point, const Run& run, reduction::Snapshots solution) {
    if (dofs_ == 0) begin(solution);
    if (solution.dof_count() != dofs_ || solution.time != snapshots_.time ||
        solution.outputs.size() != snapshots_.outputs.size())
      throw DataError(
          fmt::format("{}: this solution has {} dofs at {} times and {} outputs, others of the grid {} at {} "
                      "and {}, or other times: all must have the same",
                      run.file, solution.dof_count(), solution.time.size(), solution.outputs.size(), dofs_,
                      snapshots_.time.size(), snapshots_.outputs.size()));
    const std::size_t times = snapshots_.time.size();
    put(solution.values, point * times * dofs_, snapshots_.values);
    for (std::size_t k = 0; k < solution.outputs.size(); ++k)
      put(solution.outputs[k].values, point * times, output(solution.outputs[k].name, run).values);
  }

  [[nodiscard]] reduction::Snapshots take() { return std::move(snapshots_); }

 private:
  void begin(const reduction::Snapshots& first) {
    dofs_ = first.dof_count();
    if (!has_frame_) {
      std::vector<reduction::Axis> axes = std::move(snapshots_.axes);
      snapshots_ = first;
      snapshots_.axes = std::move(axes);
    }
    const std::size_t grid = snapshots_.grid_size(), times = snapshots_.time.size();
    snapshots_.values.assign(grid * times * dofs_, 0.0);
    for (auto& output : snapshots_.outputs) output.values.assign(grid * times, 0.0);
  }

  reduction::SnapshotOutput& output(const std::string& name, const Run& run) {
    for (auto& output : snapshots_.outputs)
      if (output.name == name) return output;
    throw DataError(fmt::format("{}: this solution has an output \"{}\", others have not", run.file, name));
  }

  static void put(const std::vector<double>& from, std::size_t at, std::vector<double>& to) {
    std::copy(from.begin(), from.end(), to.begin() + static_cast<std::ptrdiff_t>(at));
  }

  reduction::Snapshots snapshots_;
  bool has_frame_ = false;
  std::size_t dofs_ = 0;
};

/// Every `size`-th of the missing runs.
std::vector<std::size_t> share_of(const std::vector<std::size_t>& missing, const JobShare& share) {
  std::vector<std::size_t> own;
  for (auto k = static_cast<std::size_t>(share.rank); k < missing.size();
       k += static_cast<std::size_t>(share.size))
    own.push_back(missing[k]);
  return own;
}

}  // namespace

PointRuns run_points(Simulator& simulator, const RunGrid& grid, std::span<const std::vector<double>> points,
                     const JobShare& share) {
  check_axes(grid);
  // All points before the first run: a box in which there is no solution is told at once.
  for (const std::vector<double>& point : points) simulator.check(point);
  Runs runs(simulator, grid, points);
  std::vector<std::size_t> missing;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (!is_there(runs.all()[i])) missing.push_back(i);
  share.wait();  // all have seen the same parts
  const std::vector<std::size_t> own = share_of(missing, share);
  if (!own.empty()) runs.solve(own, points.size() - missing.size());
  share.wait();
  return {runs.all(), missing};
}

GridRuns run_grid(Simulator& simulator, const RunGrid& grid, const JobShare& share) {
  check_axes(grid);
  GridRuns result;
  result.snapshots.axes = grid.axes;
  const reduction::SparseGrid plan = reduction::sparse_grid(
      grid.axes, grid.sparse_level < 0 ? reduction::finest_level(grid.axes) : grid.sparse_level);
  std::vector<std::vector<double>> points;
  for (const std::size_t point : plan.points) points.push_back(result.snapshots.parameters_at(point));
  const PointRuns finished_runs = run_points(simulator, grid, points, share);
  result.runs.resize(points.size());
  for (RunSummary& run : result.runs) run.resumed = true;
  for (const std::size_t i : finished_runs.computed) result.runs[i].resumed = false;
  Gathering gathering(grid.axes, simulator.frame());
  for (std::size_t i = 0; i < points.size(); ++i) {
    FinishedRun finished = read_run(finished_runs.runs[i]);
    gathering.add(plan.points[i], finished_runs.runs[i], std::move(finished.solution));
    result.runs[i].parameters = std::move(points[i]);
    result.runs[i].record = std::move(finished.record);
  }
  result.snapshots = gathering.take();
  reduction::interpolate_others(plan, result.snapshots);
  reduction::validate(result.snapshots, "full-order runs");
  return result;
}

}  // namespace knothe::simulator
