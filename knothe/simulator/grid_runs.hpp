#pragma once
/// @file Full-order runs on a grid of parameters, in parallel processes, resumable, by any simulator.
#include <functional>
#include <string>
#include <vector>

#include "knothe/simulator/run_file.hpp"
#include "knothe/simulator/simulator.hpp"

namespace knothe::simulator {

/// What to run, and where finished runs are kept.
struct RunGrid {
  std::vector<reduction::Axis> axes;
  /// Folder of finished runs, usually `<output>.parts`; made if absent. One HDF5 file per run, its name a
  /// hash of everything the run depends on: another mesh, loading or parameter is another file.
  std::string parts_folder;
  /// −1: all points. Else those of the sparse grid of this level (reduction/sparse_grid.hpp); the others are
  /// interpolated from them.
  int sparse_level = -1;
  int processes = 2;   ///< runs at the same time
  bool quiet = false;  ///< no progress on stderr
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
  reduction::Snapshots snapshots;
  std::vector<RunSummary> runs;  ///< of the computed points, in the grid's order (last axis fastest)
};

/// Runs all points of the grid that are not in the parts folder yet, `processes` at a time, and gathers them.
/// Each member of a job computes its share, and all gather all. Bit-identical for any number of processes and
/// members, resumed or not, if the solver's solutions are.
///
/// Errors: ProjectError (options, axes), IoError (disk full; finished runs stay), NumericalError (runs that
/// failed: their parameters and what each said; a grid has no holes, so nothing is gathered then),
/// DataError (solutions that do not belong together), Interrupted (tells how many runs are kept).
[[nodiscard]] GridRuns run_grid(Simulator& simulator, const RunGrid& grid, const JobShare& share = {});

/// Finished runs at any points; `read_run` has their solutions.
struct PointRuns {
  std::vector<Run> runs;              ///< as the points are
  std::vector<std::size_t> computed;  ///< those that were not kept from before, ascending
};
/// The same for `points` in the box of `grid`, whose nodes and sparse level do not matter then. Errors
/// likewise; runs that failed leave no result.
[[nodiscard]] PointRuns run_points(Simulator& simulator, const RunGrid& grid,
                                   std::span<const std::vector<double>> points, const JobShare& share = {});

}  // namespace knothe::simulator
