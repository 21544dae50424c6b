#pragma once
/// @file The posterior by the trapezoidal rule on a tensor grid of at most three parameters, only where its
/// mass is: the plain answer, and what an update falls back on when no map represents the posterior well
/// (several modes, a ridge bent against the box).
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "knothe/numerics/integrate/grid_evaluator.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/mode_search.hpp"
#include "knothe/posterior/trust.hpp"

namespace knothe::posterior {

struct QuadratureOptions {
  enum class Axes {
    /// Those of z, on |z| ≤ 8.5: cheapest with one and two parameters.
    parameters,
    /// z = μ + L Q u with mode μ, Laplace factor L and a turn Q: fewest nodes for a narrow ridge, where each
    /// costs much.
    modes
  } axes = Axes::parameters;
  /// Refined until leaving out every other node changes the log-evidence by less than this, and means and
  /// standard deviations by less than `moment_tolerance` standard deviations. At 1e-3 moments have converged;
  /// quantiles to 1e-3 std want 1e-8.
  double evidence_tolerance = 1e-3, moment_tolerance = 1e-2;
  /// Of each axis, in the first look; 0: as many as the narrowest mode needs.
  Eigen::Index coarse_nodes = 0;
  /// The first look is at all |z| ≤ 8.5 with `coarse_nodes` along the parameters' axes, not around the modes
  /// found: the plain answer.
  bool whole_range = false;
  Eigen::Index max_nodes = 4'000'000;  ///< evaluated at once, about; none where twice as many are too few
};

/// Nodes in z with normalised weights, and what follows from them.
struct QuadraturePosterior {
  Eigen::VectorXd weights;    ///< n, sum 1
  Eigen::MatrixXd quantiles;  ///< d × levels (`k_quantile_levels`), marginal, of z
  double log_evidence = 0;
  /// Change from every other node to all of them: of the log-evidence, and of means and standard deviations
  /// along the axes in units of the standard deviation. The true error is smaller still, as the rule
  /// converges faster than any power.
  double evidence_change = 0, moment_change = 0;
  /// How much every other line of an axis differs from all, of the axis where this is most: the changes above
  /// do not see an axis that is coarser than the others.
  double line_change = 0;
  double mass_at_border = 0;  ///< share of the mass in the outermost layer of the grid
  Eigen::Index per_axis = 0;  ///< nodes
  std::int64_t evaluations = 0;
  [[nodiscard]] QuadratureFigures figures() const {
    return {evidence_change, moment_change, line_change, mass_at_border, per_axis};
  }
  [[nodiscard]] bool resolved() const { return is_resolved(figures()); }
  /// Two or three parameters along their own axes; else empty.
  struct Lattice {
    Eigen::MatrixXd axes;                             ///< nodes of each axis, n × d, z
    std::vector<numerics::GridRun> runs;              ///< all nodes looked at
    Eigen::VectorXd weights;                          ///< of all of them, sum 1
    std::vector<std::array<Eigen::Index, 3>> places;  ///< of the points, on the axes
    /// The points where these are the nodes of the axes.
    [[nodiscard]] Eigen::MatrixXd points_on(const Eigen::MatrixXd& nodes) const;
  } lattice;
  Eigen::MatrixXd turned_points;  ///< n × d, z; empty where there is a lattice
  std::vector<Eigen::Index>
      every_other;       ///< which points are every other one (three axes: as on a chequerboard)
  Eigen::MatrixXd cell;  ///< d × d, z: edges of the cell of one of these

  [[nodiscard]] Eigen::MatrixXd points() const {
    return lattice.runs.empty() ? turned_points : lattice.points_on(lattice.axes);
  }
};

/// Largest number of parameters for which an update falls back on this.
inline constexpr Eigen::Index k_max_quadrature_parameters = 2;

/// Trapezoidal rule on the smallest window that holds the mass, evaluated only near coarse nodes whose
/// density is within exp(−20) of the maximum, and refined as the options say (`resolved` says whether it came
/// to that). Of three parameters along their own axes `filled_quadrature` is cheaper. A target that is a
/// `numerics::GridEvaluator` is asked row by row. Errors: UsageError for other than 1 to 3 parameters;
/// those of `CheckedDensity`, and of `ModeSearch` for `Axes::modes`.
[[nodiscard]] QuadraturePosterior tensor_quadrature(LogDensity& target,
                                                    const QuadratureOptions& options = {});
/// The same with the workspace of another search, for one after the other.
[[nodiscard]] QuadraturePosterior tensor_quadrature(LogDensity& target, const QuadratureOptions& options,
                                                    ModeSearch& search);

}  // namespace knothe::posterior
