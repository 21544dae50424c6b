#pragma once
/// @file A full-order model as the rest of the house sees it: parameters in, solution out. No Eigen types
/// here.
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "knothe/reduction/compress/compression.hpp"
#include "knothe/reduction/compress/snapshots.hpp"

namespace knothe::simulator {

/// Solves for the field u(x, t) at given parameters, which are those of a model in its order.
class Simulator {
 public:
  virtual ~Simulator() = default;

  /// Everything a solution depends on, in words: with the same key it is the same, to the bit.
  [[nodiscard]] virtual std::string key(std::span<const double> parameters) const = 0;

  /// The solution at dimensionless `parameters` [d], as snapshots of a grid of this one point: axes of one
  /// node, times, values [n_t, n_dof]; dofs, mesh and outputs where the solver has them. NumericalError if
  /// there is no solution, with the parameters and what the solver said; DataError if it cannot be read.
  [[nodiscard]] virtual reduction::Snapshots solve(std::span<const double> parameters) = 0;

  /// The solutions at several points, in their order; `finished(n)` is called after each, from one thread at
  /// a time. This one solves one after the other.
  [[nodiscard]] virtual std::vector<reduction::Snapshots> solve_all(
      std::span<const std::vector<double>> points, const std::function<void(std::size_t)>& finished);
};

/// The fields alone, of solutions at these points.
[[nodiscard]] std::vector<reduction::OffGridSolution> fields_of(std::vector<reduction::Snapshots> solutions);

/// "Y0 = 1.07, Ad = 0.93"
[[nodiscard]] std::string describe(std::span<const std::string> names, std::span<const double> parameters);

}  // namespace knothe::simulator
