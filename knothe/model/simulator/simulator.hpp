#pragma once
/// @file A full-order model as the rest of the house sees it: parameters in, solution out. No Eigen types
/// here.
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/model/compress/compression.hpp"
#include "knothe/model/compress/snapshots.hpp"

namespace knothe::model {

/// A solution that is wanted in a file.
struct Run {
  std::vector<double> parameters;  ///< [d]
  std::string key;                 ///< Simulator::key of them
  std::string file;                ///< for run_file.hpp
};

/// Why there is no solution of one of several runs.
struct RunFailure {
  std::size_t run = 0;
  ExitStatus status = ExitStatus::numerical;  ///< or that of another kind of error
  std::string message;
};

/// Solves for the field u(x, t) at given parameters, which are those of a model in its order.
class Simulator {
 public:
  virtual ~Simulator() = default;

  /// Everything a solution depends on, in words: with the same key it is the same, to the bit.
  [[nodiscard]] virtual std::string key(std::span<const double> parameters) const = 0;

  /// The solution at dimensionless `parameters` [d], as snapshots of a grid of this one point: axes of one
  /// node, times, values [n_t, n_dof]; dofs, mesh and outputs where the solver has them. NumericalError if
  /// there is no solution, with the parameters and what the solver said; DataError if it cannot be read.
  [[nodiscard]] virtual Snapshots solve(std::span<const double> parameters) = 0;

  /// The solutions at several points, in their order; `finished(n)` is called after each, from one thread at
  /// a time. This one solves one after the other.
  [[nodiscard]] virtual std::vector<Snapshots> solve_all(std::span<const std::vector<double>> points,
                                                         const std::function<void(std::size_t)>& finished);

  /// ProjectError where it is known beforehand that there is no solution, with the reason.
  virtual void check(std::span<const double> parameters) const;
  /// What is the same in all solutions (dofs, mesh, lift), without values and axes. Nothing: each solution
  /// tells it.
  [[nodiscard]] virtual std::optional<Snapshots> frame() const;
  /// Solves `runs`, so many at the same time as `processes`, and writes each solution (without the frame) as
  /// soon as it is there; `finished(n)` as above. Returns those that failed; whether the others are still
  /// done after a failure is the solver's matter. This one solves one after the other, all. Interrupted.
  [[nodiscard]] virtual std::vector<RunFailure> solve_to_files(
      std::span<const Run> runs, int processes, const std::function<void(std::size_t)>& finished);
};

/// The fields alone, of solutions at these points.
[[nodiscard]] std::vector<OffGridSolution> fields_of(std::vector<Snapshots> solutions);

/// "Y0 = 1.07, Ad = 0.93"
[[nodiscard]] std::string describe(std::span<const std::string> names, std::span<const double> parameters);

}  // namespace knothe::model
