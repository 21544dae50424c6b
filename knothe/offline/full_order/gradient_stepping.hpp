#pragma once
/// @file One run with gradient damage: displacement and averaged strain together
/// (docs/explanation/mechanics.md).
///
/// The equivalent strain e = √(2 Y/E) is averaged by the Helmholtz equation of Peerlings et al. 1996,
/// ē - ℓ² ∇²ē = e, over the material that can be damaged (∂ē/∂n = 0 at its border), and damage is
/// d(E κ²/2) with κ the largest ē so far. It is e that is averaged, not Y: where strain localises in one row
/// of elements of width h, ∫ e dx is the crack's opening whatever h is, while ∫ Y dx goes with 1/h.
#include <span>
#include <vector>

#include "knothe/offline/full_order/full_order_model.hpp"
#include "knothe/offline/full_order/increments.hpp"

namespace knothe::offline {

/// Follows one loading from the virgin state, like LoadStepping. Unknowns: the free dofs, then ē of the nodes
/// of cells that can be damaged.
class GradientStepping {
 public:
  GradientStepping(const Structure& structure, const SolverOptions& options,
                   const DamageParameters& parameters);

  /// Goes on to the imposed displacement `target` (m) and tells how it went.
  [[nodiscard]] StepRecord advance(double target);
  [[nodiscard]] std::span<const double> displacement() const { return state_.displacement; }
  /// Mean damage of each cell.
  [[nodiscard]] std::vector<double> cell_damage() const;

  /// For tests: residual and tangent at any unknowns, from the history of the last state.
  [[nodiscard]] int unknown_count() const { return structure_.free_count() + average_count_; }
  void linearise(double imposed, std::span<const double> unknowns);
  [[nodiscard]] std::span<const double> residual() const { return residual_; }
  [[nodiscard]] const SparseMatrix& tangent() const { return tangent_; }

 private:
  struct State {
    double imposed = 0;
    std::vector<double> unknowns, displacement;
    double reaction = 0;  ///< half body, N
  };
  static constexpr int k_cell_unknowns = k_cell_dofs + k_nodes_per_cell;

  void number();
  void assemble_base();
  void evaluate_cell(std::size_t index, Stiffness stiffness);
  /// Residual, tangent and trial history at `unknowns_`. `secant` leaves out the change of damage.
  void evaluate(double imposed, Stiffness stiffness);
  /// The larger of the forces' and the averaged strain's residual, each relative to its scale.
  [[nodiscard]] double relative_residual(double imposed) const;
  [[nodiscard]] double force_scale(double imposed) const;
  /// First guess, from the last two states.
  void extrapolate(double imposed);
  [[nodiscard]] bool newton(double imposed, StepRecord& record);
  [[nodiscard]] bool secant(double imposed, StepRecord& record);
  void commit(double imposed, StepRecord& record);

  const Structure& structure_;
  const SolverOptions& options_;
  const DamageParameters parameters_;
  std::vector<std::int64_t> cells_;  ///< that can be damaged
  std::vector<int> places_;          ///< [cell][32]: unknowns of its dofs (-1: prescribed), then of its ē
  std::vector<int> positions_;       ///< [cell][32 · 32]: their places in the tangent's values, -1
  int average_count_ = 0;
  SparseMatrix base_, tangent_;  ///< base: elastic stiffness and Helmholtz operator
  std::vector<double> history_, committed_,
      trial_;  ///< [cell][point]: κ; with secant iterates, at the last state, now
  State state_, previous_;
  std::vector<double> unknowns_, displacement_, force_, residual_, correction_;
  double reaction_ = 0, average_scale_ = 0;
  double work_ = 0, dissipated_ = 0;  ///< half body, J
  UnsymmetricSolver solver_;
};

}  // namespace knothe::offline
