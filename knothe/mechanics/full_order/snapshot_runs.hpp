#pragma once
/// @file Full-order runs on a tensor grid of parameters, in parallel processes, resumable.
#include <string>
#include <vector>

#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/reduction/compress/snapshots.hpp"

namespace knothe::mechanics {

/// What to run, and where finished runs are kept.
struct SnapshotGrid {
  std::vector<reduction::Axis>
      axes;  ///< "Y0", "Ad", in any order, with `reference` the physical value of 1.0
  /// Folder of finished runs, usually `<output>.parts`; made if absent. One HDF5 file per run, its name a
  /// hash of everything the run depends on: another mesh, loading or parameter is another file.
  std::string parts_folder;
  /// −1: all points. Else those of the sparse grid of this level (reduction/sparse_grid.hpp); the others are
  /// interpolated from them.
  int sparse_level = -1;
  int processes = 2;   ///< runs at the same time
  bool quiet = false;  ///< no progress on stderr
};

/// How one run of the grid went.
struct RunSummary {
  std::vector<double> parameters;  ///< dimensionless, per axis
  bool resumed = false;            ///< read from the parts folder, not computed now
  int newton_iterations = 0;
  int secant_iterations = 0;
  double cpu_seconds = 0;
  std::vector<int>
      steps_without_equilibrium;  ///< step numbers from 0; their residuals are an output of the snapshots
};

struct SnapshotRuns {
  reduction::Snapshots snapshots;
  std::vector<RunSummary> runs;  ///< of the computed points, in the grid's order (last axis fastest)
};

/// Runs all points of the grid that are not in the parts folder yet, each in a process of its own, and
/// gathers them. In an MPI job (ranks.hpp) each rank computes its share, `processes` at a time, and all
/// gather all: the parts folder must be one that every rank sees. Bit-identical for any number of processes
/// and ranks, resumed or not. Outputs: reaction_force [N], crack_mouth_opening [m], imposed_displacement [m],
/// equilibrium_residual [1].
///
/// Errors: ProjectError (options, axes), IoError (disk full; finished runs stay), NumericalError (a process
/// died: names run and parameters), Interrupted (Ctrl-C: tells how many runs are kept).
[[nodiscard]] SnapshotRuns run_snapshots(const BeamProblem& problem, const SnapshotGrid& grid);

}  // namespace knothe::mechanics
