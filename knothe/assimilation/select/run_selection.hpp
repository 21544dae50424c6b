#pragma once
/// @file Which full-order runs to make for planned sensors (docs/explanation/adaptive-runs.md).
#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <vector>

#include "knothe/assimilation/select/expected_shift.hpp"
#include "knothe/numerics/functions/sparse_interpolation.hpp"

namespace knothe::assimilation {

struct RunSelectionOptions {
  double shift = 0.1;         ///< wanted, in posterior standard deviations
  std::size_t runs = 400;     ///< largest number, the held-out ones among them
  int largest_degree = 40;    ///< in one parameter
  Eigen::Index held_out = 8;  ///< runs at points of the priors that nothing is made from
};

/// Where the selection stands after some runs.
struct RunSelectionStep {
  std::size_t runs = 0;  ///< with those held out and those that failed
  double expected = 0;   ///< shift if the last degrees were missing, by the interpolation itself
  double held_out = 0;   ///< largest shift by the errors at the held-out runs
  [[nodiscard]] double shift() const { return std::max(expected, held_out); }
};

/// The predictions of all sensors at all times in units of their noise: a row for each point, n × N; NaN
/// where there is no solution.
using Predictions = std::function<Eigen::MatrixXd(const std::vector<std::vector<double>>& points)>;

struct SelectedRuns {
  numerics::SparseInterpolation interpolation;
  std::vector<std::vector<double>> points;           ///< its nodes, in the order of the indices
  std::vector<std::vector<double>> held_out_points;  ///< runs made before all others
  Eigen::MatrixXd surpluses;                         ///< of the predictions, |Λ| × N
  std::vector<RunSelectionStep> history;
  bool reached = false;    ///< the shift that was wanted
  std::size_t failed = 0;  ///< points without a solution, which are none of these
};

/// The held-out runs, and three values of each parameter.
[[nodiscard]] std::size_t min_runs(const RunSelectionOptions& options, std::size_t parameters);

/// Makes runs until the shift is as wanted or no more are allowed. Degrees grow by DegreeGrowth with
/// ExpectedShift::of_each as indicators; they grow evenly where the held-out runs contradict the expectation
/// (a surplus may vanish at a node and nowhere else). What is asked next depends on the predictions alone:
/// the same runs give the same selection to the bit. `priors` are truncated to the box; `told`, if any, is
/// called after each round. A point without a solution is left out, and so are the degrees that build on it.
/// UsageError for a shift that is not positive, or fewer runs than the held-out ones and two for each
/// parameter; NumericalError where there is no solution at half of the held-out points, in the middle of the
/// box or at the end of an axis that begins in the middle.
[[nodiscard]] SelectedRuns select_runs(const std::vector<posterior::Prior>& priors,
                                       const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
                                       const RunSelectionOptions& options, const Predictions& predictions,
                                       const std::function<void(const SelectedRuns&)>& told = {});

/// How many runs more it will take to the wanted shift, if it goes on falling with a power of their number as
/// in the last half of them; never more than are allowed.
[[nodiscard]] std::size_t runs_to_go(const std::vector<RunSelectionStep>& history,
                                     const RunSelectionOptions& options);

}  // namespace knothe::assimilation
