#pragma once
/// @file The global stage of LATIN-PGD over a window of steps, for one batch of parameter points.
#include <Eigen/Core>
#include <span>
#include <vector>

#include "knothe/offline/latin/latin_step.hpp"

namespace knothe::offline {

/// The state of a parameter point that is farthest from equilibrium in the window: what a new mode is made
/// of.
struct LatinCandidate {
  double elastic_error = -1;  ///< largest |G × out-of-balance forces| on any dof, m
  int step = 0;
  Eigen::VectorXd residual;     ///< out-of-balance forces on the active dofs, N (half body)
  LaneBatch lane;               ///< alone, with the history before the step
  Eigen::VectorXd coordinates;  ///< r + 1
};

/// What takes a candidate's out-of-balance forces away.
struct LatinCorrection {
  Eigen::VectorXd displacement, force;  ///< on the active dofs
  double size = 0;                      ///< largest displacement on any of them, m
};

/// With the tangent of the law at that state; else with the secant; else elastic.
[[nodiscard]] LatinCorrection correct(const LatinBody& body, const LatinBasis& basis,
                                      const LatinCandidate& candidate);

/// What one batch of L lanes brings back.
struct LatinStageResult {
  std::vector<int> points;
  std::vector<Eigen::MatrixXd> coordinates;  ///< per step of the window, working (r + 1) × L
  Eigen::MatrixXd residual;                  ///< L × steps: out-of-balance forces / reaction force
  Eigen::MatrixXd reaction;                  ///< L × steps, whole body, N
  Eigen::MatrixXd history;                   ///< at the end of the window, L × n_g
  std::vector<LatinCandidate> candidates;    ///< one of each lane
  std::vector<char> solved;                  ///< whether all small problems of the lane converged
  long local_points = 0;                     ///< evaluations of the local stage
};

/// Where the stage is and what was found before; all of it stays as it is while batches run.
struct LatinStage {
  const LatinBody& body;
  const LatinBasis& basis;
  const LatinStepOptions& options;
  double displacement = 0;  ///< of the last step, m
  int steps = 0;
  /// Archive coordinates of every step for all parameter points, (R' + 1) × P, R' ≤ R.
  const std::vector<Eigen::MatrixXd>& found;
  int first = 0, last = 0;  ///< the window
  bool fresh = true;        ///< first visit: start from the line through the last two steps
  bool rescue = false;  ///< cut the step, and go on with irreversible secant iterations, where Newton fails
  /// Working coordinates that a hybrid start expects at steps first − 1, …, last − 1 (r × P each), or empty:
  /// the first iterates are then the states before plus the increments expected.
  std::span<const Eigen::MatrixXd> expected;

  [[nodiscard]] double imposed(int step) const { return displacement * (step + 1) / steps; }
  [[nodiscard]] LatinStageResult run(LaneBatch batch) const;

 private:
  [[nodiscard]] Eigen::MatrixXd states(int step, const LatinStageResult& result) const;
  [[nodiscard]] Eigen::MatrixXd guess(int step, const LatinStageResult& result) const;
  /// Lanes whose small problems did not converge: harder, slower ways.
  void retry(LatinStep& stepper, LaneBatch& batch, int step, Eigen::MatrixXd& coordinates,
             Eigen::MatrixXd& damage, std::vector<char>& converged, LatinStageResult& result) const;
  void balance(LatinStep& stepper, const LaneBatch& batch, int step, LatinStageResult& result) const;
};

}  // namespace knothe::offline
