#pragma once
/// @file Walks from the outermost draws: what the draws never reached, no weight of theirs can tell.
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "knothe/posterior/checked_density.hpp"
#include "knothe/posterior/draws/mixture.hpp"

namespace knothe::posterior {

struct OutwardWalkOptions {
  int steps = 40;                    ///< of each walk
  Eigen::Index most_variables = 10;  ///< walks begin at both ends of so many; by turns, if there are more
  std::uint64_t seed = 1;
};

/// Weighted draws, and what they are draws from.
struct DrawsToJudge {
  const Eigen::MatrixXd& points;     ///< z, n × d
  const Eigen::MatrixXd& variables;  ///< of the points, n × k: those whose moments count
  const Eigen::VectorXd& weights;    ///< n, sum 1
  /// Log of the weight that a draw at each of these points (m × d) would have had, its log π̄ [m] given.
  std::function<Eigen::VectorXd(const Eigen::MatrixXd&, const Eigen::VectorXd&)> log_weight;
  std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)> to_variables;  ///< empty: the same
  Eigen::MatrixXd more_starts = {};                                     ///< m × d: of walks besides
};

/// Where the target has mass that the draws have hardly seen.
struct MassBeyond {
  /// One draw there would have moved a mean by so many standard deviations, a standard deviation by this
  /// share.
  double mean_shift = 0, deviation_shift = 0;
  std::vector<MixtureComponent> places;  ///< to draw from, widely; empty: nothing found

  [[nodiscard]] bool found() const { return !places.empty(); }
};

/// Metropolis walks that begin at the draws at both ends of each variable, where weights tell most, and at
/// `more_starts`. Steps
/// have the shape of the target there, by its curvature, and follow it along bent ridges and into narrow
/// necks. The states are draws of the target near the border of what the weighted draws have reached. One
/// that would have had a weight which alone moves a moment by more than a third of what is tolerated shows
/// mass that hardly any draw stands for.
[[nodiscard]] MassBeyond walk_outwards(CheckedDensity& target, const DrawsToJudge& draws,
                                       const OutwardWalkOptions& options = {});

/// About what `walk_outwards` evaluates, in values of a density that has no derivatives.
[[nodiscard]] std::int64_t cost_of_walks(Eigen::Index dimension, Eigen::Index more_starts,
                                         const OutwardWalkOptions& options = {});

}  // namespace knothe::posterior
