#pragma once
/// @file Full-order runs on a grid of parameters, in parallel processes, resumable, by any simulator.
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "knothe/model/simulator/run_file.hpp"
#include "knothe/model/simulator/simulator.hpp"

namespace knothe::model {

/// What to run, and where finished runs are kept.
struct RunGrid {
  std::vector<Axis> axes;
  /// Folder of finished runs, usually `<output>.parts`; made if absent. One HDF5 file per run, its name a
  /// hash of everything the run depends on: another mesh, loading or parameter is another file.
  std::string parts_folder;
  /// −1: all points. Else those of the sparse grid of this level (reduction/sparse_grid.hpp); the others are
  /// interpolated from them.
  int sparse_level = -1;
  int processes = 2;                      ///< runs at the same time
  bool quiet = false;                     ///< no progress on stderr
  std::string label = "full-order runs";  ///< for progress and messages, in the plural
  /// Runs that fail are told on stderr and left out, instead of an error; not with a sparse level.
  bool leave_out_failed = false;
};

/// The processes of one job that share the runs of a grid, each with the same grid and parts folder.
struct JobShare {
  int rank = 0;
  int size = 1;
  std::function<void()> wait = [] {};  ///< until all others wait too
};

/// How one run of the grid went.
struct RunSummary {
  std::vector<double> parameters;  ///< dimensionless, per axis
  bool resumed = false;            ///< read from the parts folder, not computed now
  RunRecord record;
};

struct GridRuns {
  Snapshots snapshots;
  std::vector<RunSummary> runs;  ///< of the computed points, in the grid's order (last axis fastest)
  std::size_t failed = 0;        ///< runs left out
};

/// Runs all points of the grid that are not in the parts folder yet, `processes` at a time, and gathers them.
/// Each member of a job computes its share, and all gather all. Bit-identical for any number of processes and
/// members, resumed or not, if the solver's solutions are. Where failed runs are left out, nodes of the axes
/// are, so that the rest is a grid without holes (`grid_without`): the box may be smaller then.
///
/// Errors: ProjectError (options, axes), IoError (disk full; finished runs stay), NumericalError (runs that
/// failed: their parameters and what each said; or too many of those left out), DataError (solutions that do
/// not belong together), Interrupted (tells how many runs are kept).
[[nodiscard]] GridRuns run_grid(Simulator& simulator, const RunGrid& grid, const JobShare& share = {});

/// Finished runs at any points; `read_run` has their solutions.
struct PointRuns {
  std::vector<Run> runs;              ///< as the points are
  std::vector<std::size_t> computed;  ///< those that were not kept from before, ascending
  std::vector<std::size_t> failed;    ///< those without a solution, ascending; empty unless they are left out
};
/// The same for `points` in the box of `grid`, whose nodes and sparse level do not matter then. Errors
/// likewise; unless they are left out, runs that failed leave no result.
[[nodiscard]] PointRuns run_points(Simulator& simulator, const RunGrid& grid,
                                   std::span<const std::vector<double>> points, const JobShare& share = {});

/// Parameters of all points of the grid that are computed, in its order.
[[nodiscard]] std::vector<std::vector<double>> points_of(const RunGrid& grid);

/// Which nodes of the axes of a tensor grid of this shape to keep so that none of the points `failed` (last
/// axis fastest) is left, ascending: the node that takes the most failed points for each point lost goes
/// first. NumericalError where an axis would keep fewer than two nodes, or than half of its nodes.
[[nodiscard]] std::vector<std::vector<std::size_t>> grid_without(std::span<const std::size_t> shape,
                                                                 std::span<const std::size_t> failed);

}  // namespace knothe::model
