#pragma once
/// @file From LATIN-PGD on a grid of parameters to what model::compress takes.
#include "knothe/model/grid/grid_solutions.hpp"
#include "knothe/offline/full_order/offline.hpp"
#include "knothe/offline/latin/latin_pgd.hpp"

namespace knothe::offline {

/// The solution as what compression takes: sums of space modes, which are not expanded. Same outputs as
/// snapshots, in the same order.
struct LatinModel {
  model::GridSolutions grid;
  LatinSolution solution;
};

/// Solves at all grid points of the axes ("Y0", "Ad") together. If `parts_folder` is not empty, a run that is
/// interrupted leaves its state there and goes on from it; the folder is made, and removed if it is empty in
/// the end. `start_file`: a model to start from (latin_start.hpp), or empty. Errors: ProjectError (options,
/// axes), DataError (mesh), NumericalError (solver), IoError (folder), Interrupted.
[[nodiscard]] LatinModel solve_latin_grid(const BeamProblem& problem, const std::vector<model::Axis>& axes,
                                          LatinOptions options, const std::string& parts_folder = {},
                                          const std::string& start_file = {});

/// Grid points at which some window was left before it was accurate, with the number of such windows each.
[[nodiscard]] std::vector<std::pair<std::size_t, int>> inaccurate_points(const LatinSolution& solution);

}  // namespace knothe::offline
