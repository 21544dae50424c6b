#pragma once
/// @file LATIN-PGD of the damageable body over space, time and parameters (docs/explanation/latin.md; Rubio
/// et al. 2019, §3.1 and §6.2; Ladevèze 1999).
#include <Eigen/Core>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/full_order_model.hpp"
#include "knothe/offline/latin/latin_start.hpp"
#include "knothe/offline/latin/latin_step.hpp"

namespace knothe::offline {

/// How the solution is built. Defaults suit the paper's beam.
struct LatinOptions {
  /// A window is left when the displacement that would take the out-of-balance forces away is below this on
  /// every dof, at every step and parameter point (m) …
  double accuracy = 1e-7;
  /// … or those forces are below this fraction of the reaction force (StepRecord::residual).
  double tolerance = 1e-6;
  int window = 2;           ///< steps iterated together; all steps: LATIN as first proposed
  int max_modes = 2000;     ///< archived space modes at most; 70,000 dofs take some 430
  int modes_per_round = 6;  ///< new modes between two global stages at most
  int rounds = 60;          ///< global stages for a window at most
  int rescue_round =
      3;  ///< from this round on, lanes whose Newton iterations fail are followed in smaller steps
  /// Working modes that represent the last window's states to this fraction of `accuracy` (root mean square,
  /// norm over dofs) are kept for the next; 0: all.
  double recompression = 0.1;
  double activation = 0.7;  ///< a cell joins when its Y exceeds this fraction of Y₀ at any parameter point
  LatinStepOptions step;    ///< of the small problems
  LatinStart start;         ///< hybrid start; empty: the elastic solution
  std::size_t threads = 0;  ///< 0: all
  bool quiet = true;        ///< no progress on stderr
  /// Where a run that is interrupted leaves its state, and goes on from (latin_state.hpp); empty: nowhere.
  std::string state_file;
  /// What tells this run from others that might have left a state there.
  std::string key;
  std::function<void(int)> on_window;  ///< called after each window with the number of steps that are done

  /// Throws ProjectError naming the option that makes no sense.
  void validate() const;
};

/// One global stage: a round over a window.
struct LatinIteration {
  int first_step = 0, last_step = 0;  ///< the window, [first, last)
  int round = 0;
  int working_modes = 0, archived_modes = 0;
  int lanes = 0;          ///< parameter points that were computed
  double residual = 0;    ///< largest out-of-balance forces / reaction force over them and the window
  double correction = 0;  ///< largest displacement that would take them away, m (estimated but for the worst)
  double indicator = 0;   ///< relative change of the solution since the last round (energy norm); 1 at first
  double cpu_seconds = 0;  ///< since the start
};

/// u(x, t, p) = τ u_lift + Σ_l U_l(x) c_l(t, p) at the grid points.
struct LatinSolution {
  Eigen::MatrixXd space;                     ///< U, n_dof × R
  std::vector<Eigen::MatrixXd> coordinates;  ///< for each step (R + 1) × P; row 0 is τ, m
  Eigen::MatrixXd residual;                  ///< P × steps: out-of-balance forces / reaction force
  Eigen::MatrixXd reaction;                  ///< P × steps, whole body, N
  Eigen::MatrixXi accepted;                  ///< P × windows; 0 where the rounds did not suffice
  std::vector<LatinIteration> history;
  long local_points = 0;  ///< Gauss point × step × parameter evaluations of the local stage
  int active_cells = 0;
  double cpu_seconds = 0;  ///< of this process

  /// Displacement of all dofs at step and parameter point.
  [[nodiscard]] Eigen::VectorXd displacement(const Structure& structure, std::size_t step, Index point) const;
};

/// Solves for all `parameters` together. Deterministic for any number of threads. NumericalError if
/// `max_modes` do not suffice; Interrupted when the user asks to stop: finished windows are kept in
/// `state_file`, which is written every half minute, too, and removed at the end. A run that goes on from
/// there ends as if it had never stopped, to the bit. IoError if it cannot be written.
[[nodiscard]] LatinSolution solve_latin_pgd(std::shared_ptr<const Structure> structure,
                                            const SolverOptions& loading,
                                            std::span<const DamageParameters> parameters,
                                            const LatinOptions& options);

}  // namespace knothe::offline
