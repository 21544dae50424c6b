#include "knothe/model/simulator/grid_runs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <map>
#include <numeric>
#include <regex>

#include "knothe/base/index.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/base/text.hpp"
#include "knothe/model/grid/sparse_grid.hpp"

namespace knothe::model {
namespace {

void check_axes(const RunGrid& grid) {
  if (grid.axes.empty()) throw ProjectError("the offline phase needs at least one parameter axis");
  for (const auto& axis : grid.axes) {
    if (axis.nodes.size() < 2)
      throw ProjectError(fmt::format("parameter {}: its axis has {} node(s); at least 2 are needed",
                                     axis.name, axis.nodes.size()));
    for (Index i = 1; i < std::ssize(axis.nodes); ++i)
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
  if (grid.leave_out_failed && grid.sparse_level >= 0)
    throw ProjectError("a sparse grid needs all its runs: those that fail cannot be left out");
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
    for (const Axis& axis : grid.axes) names_.push_back(axis.name);
    std::error_code failed;
    std::filesystem::create_directories(grid.parts_folder, failed);
    if (failed)
      throw IoError(fmt::format("cannot make the folder {} for finished runs: {}", grid.parts_folder,
                                failed.message()));
  }

  [[nodiscard]] const std::vector<Run>& all() const { return runs_; }

  /// Solves for `missing`, which are some of those that are not there. Failures are an error, or told.
  void solve(std::vector<std::size_t> missing, std::size_t there) {
    Progress progress(grid_.label, runs_.size(), grid_.quiet);
    std::vector<RunFailure> failures;
    while (!missing.empty()) {
      progress.advance_to(there);
      std::vector<RunFailure> failed = attempt(missing, there, progress);
      if (failed.empty()) break;
      // A solver may stop at the first failure: the others are still to be done.
      std::vector<std::size_t> left;
      for (const std::size_t i : missing) {
        const bool has_failed =
            std::any_of(failed.begin(), failed.end(), [&](const RunFailure& f) { return f.run == i; });
        if (is_there(runs_[i]))
          ++there;
        else if (!has_failed)
          left.push_back(i);
      }
      missing = std::move(left);
      failures.insert(failures.end(), std::make_move_iterator(failed.begin()),
                      std::make_move_iterator(failed.end()));
      const bool is_fatal = failures.back().status == ExitStatus::io;
      if (is_fatal || !grid_.leave_out_failed) complain_of(failures);
    }
    if (!failures.empty()) warn_of(failures);
  }

  /// A solver that stops early may say that all is well: a solution with other dofs, times or outputs than
  /// most is a run that failed.
  void reject_unlike(const JobShare& share) {
    std::map<Shape, std::vector<std::size_t>> of_shape;
    for (Index i = 0; i < std::ssize(runs_); ++i)
      if (is_there(runs_[i])) of_shape[Shape(read_run(runs_[i]).solution)].push_back(i);
    share.wait();  // all have seen them
    if (of_shape.size() < 2) return;
    const auto usual = std::max_element(of_shape.begin(), of_shape.end(), [](const auto& a, const auto& b) {
      return std::pair(a.second.size(), a.first.time.size()) <
             std::pair(b.second.size(), b.first.time.size());
    });
    std::vector<RunFailure> failures;
    for (auto it = of_shape.begin(); it != of_shape.end(); ++it) {
      if (it == usual) continue;
      for (const std::size_t i : it->second) {
        failures.push_back({i, ExitStatus::numerical, it->first.against(usual->first)});
        std::error_code ignored;
        std::filesystem::remove(runs_[i].file, ignored);
      }
    }
    std::sort(failures.begin(), failures.end(), [](const auto& a, const auto& b) { return a.run < b.run; });
    if (!grid_.leave_out_failed) complain_of(failures);
    if (share.rank == 0) warn_of(failures);
  }

 private:
  /// What all solutions of a grid have in common.
  struct Shape {
    std::size_t dofs;
    std::vector<double> time;
    std::vector<std::string> outputs;

    explicit Shape(const Snapshots& solution) : dofs(solution.dof_count()), time(solution.time) {
      for (const SnapshotOutput& output : solution.outputs) outputs.push_back(output.name);
    }
    auto operator<=>(const Shape&) const = default;
    [[nodiscard]] std::string against(const Shape& usual) const {
      if (dofs != usual.dofs) return fmt::format("it has {} dofs, others {}", dofs, usual.dofs);
      if (time.size() != usual.time.size())
        return fmt::format("it has {} times, up to {:g}, others {}, up to {:g}", time.size(),
                           time.empty() ? 0 : time.back(), usual.time.size(), usual.time.back());
      if (outputs != usual.outputs)
        return fmt::format("it has the outputs {}, others {}", fmt::join(outputs, ", "),
                           fmt::join(usual.outputs, ", "));
      std::size_t i = 0;
      while (time[i] == usual.time[i]) ++i;
      return fmt::format("its time {} is {:g}, that of others {:g}", i + 1, time[i], usual.time[i]);
    }
  };

  void warn_of(const std::vector<RunFailure>& failures) const {
    fmt::print(stderr, "knothe: warning: {} of {} {} failed and {} left out:{}\n", failures.size(),
               runs_.size(), grid_.label, failures.size() == 1 ? "is" : "are", listed(failures));
  }
  [[nodiscard]] std::vector<RunFailure> attempt(const std::vector<std::size_t>& missing, std::size_t there,
                                                Progress& progress) {
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
    return failures;
  }

  [[nodiscard]] std::string kept() const {
    return fmt::format("{} of {} runs are kept in {}; the same command goes on from there",
                       std::count_if(runs_.begin(), runs_.end(), is_there), runs_.size(), grid_.parts_folder);
  }
  [[nodiscard]] std::string at(std::size_t run) const { return describe(names_, runs_[run].parameters); }

  /// A line each, of those that failed alike, whatever the folder of the run, for the first three.
  [[nodiscard]] std::string listed(const std::vector<RunFailure>& failures) const {
    constexpr std::size_t k_shown = 20, k_alike = 3;
    static const std::regex folder("run-[A-Za-z0-9]{6}");
    std::map<std::string, std::size_t> alike;
    std::string lines;
    std::size_t shown = 0;
    for (const RunFailure& failure : failures) {
      if (++alike[std::regex_replace(failure.message, folder, "")] > k_alike || shown == k_shown) continue;
      lines += fmt::format("\n  run {} ({}): {}", failure.run + 1, at(failure.run), failure.message);
      ++shown;
    }
    if (shown < failures.size())
      lines += fmt::format("\n  and {} more{}", failures.size() - shown,
                           alike.size() == 1 ? " in the same way" : "");
    return lines;
  }

  [[noreturn]] void complain_of(const std::vector<RunFailure>& failures) const {
    std::string what;
    if (failures.size() == 1) {
      const std::size_t run = failures[0].run;
      what = fmt::format("full-order run {} of {} ({}) failed: {}; {}", run + 1, runs_.size(), at(run),
                         failures[0].message, kept());
    } else {
      what = fmt::format("{} of {} {} failed; {}:{}", failures.size(), runs_.size(), grid_.label, kept(),
                         listed(failures));
    }
    if (failures.back().status == ExitStatus::io) throw IoError(what);
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
  Gathering(std::vector<Axis> axes, std::optional<Snapshots> frame) {
    has_frame_ = frame.has_value();
    if (frame) snapshots_ = std::move(*frame);
    snapshots_.axes = std::move(axes);
  }

  void add(std::size_t point, const Run& run, Snapshots solution) {
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
    for (Index k = 0; k < std::ssize(solution.outputs); ++k)
      put(solution.outputs[k].values, point * times, output(solution.outputs[k].name, run).values);
  }

  [[nodiscard]] Snapshots extract() { return std::move(snapshots_); }

 private:
  void begin(const Snapshots& first) {
    dofs_ = first.dof_count();
    if (!has_frame_) {
      std::vector<Axis> axes = std::move(snapshots_.axes);
      snapshots_ = first;
      snapshots_.axes = std::move(axes);
    }
    const std::size_t grid = snapshots_.grid_size(), times = snapshots_.time.size();
    snapshots_.values.assign(grid * times * dofs_, 0.0);
    for (auto& output : snapshots_.outputs) output.values.assign(grid * times, 0.0);
  }

  SnapshotOutput& output(const std::string& name, const Run& run) {
    for (auto& output : snapshots_.outputs)
      if (output.name == name) return output;
    throw DataError(fmt::format("{}: this solution has an output \"{}\", others have not", run.file, name));
  }

  static void put(const std::vector<double>& from, std::size_t at, std::vector<double>& to) {
    std::copy(from.begin(), from.end(), to.begin() + at);
  }

  Snapshots snapshots_;
  bool has_frame_ = false;
  std::size_t dofs_ = 0;
};

SparseGrid plan_of(const RunGrid& grid) {
  return sparse_grid(grid.axes, grid.sparse_level < 0 ? finest_level(grid.axes) : grid.sparse_level);
}

/// Every `size`-th of the missing runs.
std::vector<std::size_t> share_of(const std::vector<std::size_t>& missing, const JobShare& share) {
  std::vector<std::size_t> own;
  for (std::size_t k = share.rank; k < missing.size(); k += share.size) own.push_back(missing[k]);
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
  for (Index i = 0; i < std::ssize(points); ++i)
    if (!is_there(runs.all()[i])) missing.push_back(i);
  share.wait();  // all have seen the same parts
  const std::vector<std::size_t> own = share_of(missing, share);
  if (!own.empty()) runs.solve(own, points.size() - missing.size());
  share.wait();
  if (!simulator.frame()) runs.reject_unlike(share);
  share.wait();
  PointRuns result{runs.all(), {}, {}};
  for (Index i = 0; i < std::ssize(points); ++i) {
    if (grid.leave_out_failed && !is_there(runs.all()[i]))
      result.failed.push_back(i);
    else if (std::binary_search(missing.begin(), missing.end(), i))
      result.computed.push_back(i);
  }
  return result;
}

std::vector<std::vector<double>> points_of(const RunGrid& grid) {
  check_axes(grid);
  Snapshots frame;
  frame.axes = grid.axes;
  std::vector<std::vector<double>> points;
  for (const std::size_t point : plan_of(grid).points) points.push_back(frame.parameters_at(point));
  return points;
}

std::vector<std::vector<std::size_t>> grid_without(std::span<const std::size_t> shape,
                                                   std::span<const std::size_t> failed) {
  std::vector<std::vector<std::size_t>> kept;
  for (const std::size_t nodes : shape) {
    kept.emplace_back(nodes);
    std::iota(kept.back().begin(), kept.back().end(), std::size_t{0});
  }
  std::vector<std::vector<std::size_t>> holes;  // as node of each axis
  for (std::size_t point : failed) {
    holes.emplace_back(shape.size());
    for (std::size_t i = shape.size(); i-- > 0; point /= shape[i]) holes.back()[i] = point % shape[i];
  }
  while (!holes.empty()) {
    std::size_t axis = 0, node = 0;
    double best =
        -1;  // failed points taken × nodes of the axis: each node holds the same share of the points
    for (Index i = 0; i < std::ssize(shape); ++i)
      for (const std::size_t n : kept[i]) {
        const auto taken =
            std::count_if(holes.begin(), holes.end(), [&](const auto& hole) { return hole[i] == n; });
        const double worth = 1.0 * taken * kept[i].size();
        if (taken > 0 && worth > best) {
          best = worth;
          axis = i;
          node = n;
        }
      }
    std::erase(kept[axis], node);
    std::erase_if(holes, [&](const auto& hole) { return hole[axis] == node; });
    if (kept[axis].size() < 2 || 2 * kept[axis].size() < shape[axis])
      throw NumericalError(fmt::format(
          "{} of the grid's runs failed, too many to do without: more than half of the nodes of parameter {} "
          "would have to go. Make the box smaller (finished runs are kept)",
          failed.size(), axis + 1));
  }
  return kept;
}

namespace {

/// The grid that is left without the failed runs, with `points` the places of its points in the whole one.
struct Rest {
  std::vector<Axis> axes;
  std::vector<std::size_t> points;
};

Rest rest_of(const RunGrid& grid, const std::vector<std::size_t>& failed) {
  std::vector<std::size_t> shape;
  for (const Axis& axis : grid.axes) shape.push_back(axis.nodes.size());
  const auto kept = grid_without(shape, failed);
  Rest rest{grid.axes, {0}};
  for (Index i = 0; i < std::ssize(kept); ++i) {
    std::vector<double> left_out;
    for (std::size_t n = 0; n < shape[i]; ++n)
      if (!std::binary_search(kept[i].begin(), kept[i].end(), n)) left_out.push_back(grid.axes[i].nodes[n]);
    if (!left_out.empty() && !grid.quiet)
      fmt::print(stderr,
                 "knothe: warning: the grid is left without {} = {:g}: it has {} nodes from {:g} to {:g}\n",
                 grid.axes[i].name, fmt::join(left_out, ", "), kept[i].size(),
                 grid.axes[i].nodes[kept[i].front()], grid.axes[i].nodes[kept[i].back()]);
    rest.axes[i].nodes.clear();
    std::vector<std::size_t> points;
    for (const std::size_t n : kept[i]) rest.axes[i].nodes.push_back(grid.axes[i].nodes[n]);
    for (const std::size_t before : rest.points)
      for (const std::size_t n : kept[i]) points.push_back(before * shape[i] + n);
    rest.points = std::move(points);
  }
  return rest;
}

}  // namespace

GridRuns run_grid(Simulator& simulator, const RunGrid& grid, const JobShare& share) {
  const std::vector<std::vector<double>> points = points_of(grid);
  const SparseGrid plan = plan_of(grid);
  const PointRuns finished_runs = run_points(simulator, grid, points, share);
  // Where none failed that is the grid itself, or all points of the sparse one.
  Rest rest{grid.axes, {}};
  if (!finished_runs.failed.empty()) rest = rest_of(grid, finished_runs.failed);
  if (finished_runs.failed.empty()) {
    rest.points.resize(points.size());
    std::iota(rest.points.begin(), rest.points.end(), std::size_t{0});
  }
  GridRuns result;
  result.failed = finished_runs.failed.size();
  Gathering gathering(rest.axes, simulator.frame());
  for (Index k = 0; k < std::ssize(rest.points); ++k) {
    const std::size_t i = rest.points[k];
    FinishedRun finished = read_run(finished_runs.runs[i]);
    gathering.add(finished_runs.failed.empty() ? plan.points[i] : k, finished_runs.runs[i],
                  std::move(finished.solution));
    const bool is_new = std::binary_search(finished_runs.computed.begin(), finished_runs.computed.end(), i);
    result.runs.push_back({points[i], !is_new, std::move(finished.record)});
  }
  result.snapshots = gathering.extract();
  if (finished_runs.failed.empty()) interpolate_others(plan, result.snapshots);
  validate(result.snapshots, "full-order runs");
  return result;
}

}  // namespace knothe::model
