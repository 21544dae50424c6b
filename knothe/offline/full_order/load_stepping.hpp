#pragma once
/// @file One run of the full-order model: the damage history, Newton's method and its fallbacks.
#include <span>
#include <vector>

#include "knothe/offline/full_order/equilibrium_system.hpp"
#include "knothe/offline/full_order/full_order_model.hpp"
#include "knothe/offline/full_order/increments.hpp"

namespace knothe::offline {

/// Follows one loading from the virgin state. States are reached in increments of the imposed displacement;
/// each ends with `commit`, after which the damage cannot go back.
class LoadStepping {
 public:
  /// `ratios`: r of each cell (regularisation.hpp), 1 without a crack band; must outlive the object.
  LoadStepping(const Structure& structure, EquilibriumSystem& system, const SolverOptions& options,
               const DamageParameters& parameters, std::span<const double> ratios);

  /// Goes on to the imposed displacement `target` (m) and tells how it went.
  [[nodiscard]] StepRecord advance(double target);
  [[nodiscard]] std::span<const double> displacement() const { return state_.displacement; }
  /// Mean damage of each cell, that of the reference law where the crack band scales it.
  [[nodiscard]] std::vector<double> cell_damage() const;

 private:
  /// An equilibrium: what is needed to start from it and to balance energies.
  struct State {
    double imposed = 0;
    std::vector<double> displacement;  ///< n_dof
    double reaction = 0;               ///< half body, N
  };
  void set_active();
  void gather_unknowns(std::span<const double> displacement);
  /// The last state, or the straight line through the last two.
  void start_guess(double imposed, bool extrapolate);
  [[nodiscard]] CellVector cell_displacement(double imposed, std::size_t index,
                                             const std::array<int, k_cell_dofs>& dofs) const;
  /// Damage force and its derivative of one active cell; whether it is damaged at all.
  bool evaluate_cell(std::size_t index, const CellVector& u, Stiffness stiffness, CellVector& force);
  /// Damage forces, their derivatives and the trial damage at `unknowns_`. `secant` leaves out the change of
  /// damage from the derivative.
  void evaluate(double imposed, Stiffness stiffness);
  /// Residual of `unknowns_` after `evaluate`, relative to the reaction; fills `residual_`.
  [[nodiscard]] double relative_residual(double imposed);
  [[nodiscard]] double force_scale(double reaction, double imposed) const;
  /// Newton's method with the active cells as they are; whether it converged.
  [[nodiscard]] bool newton_iterations(double imposed, StepRecord& record);
  /// The same, with cells joining until no other is above its threshold. Leaves the state in `expanded_`.
  [[nodiscard]] bool newton(double imposed, StepRecord& record);
  /// Irreversible secant iterations: damage reached by any iterate stays, so the sequence is monotone; every
  /// now and then Newton's method tries to finish.
  [[nodiscard]] bool secant(double imposed, StepRecord& record);
  /// If in `expanded_` an inactive cell's Y is above `trigger` Y₀, all above `activation` Y₀ join. Whether
  /// any did.
  bool activate(double trigger);
  void store_trial_damage(std::vector<double>& damage) const;
  /// Makes `expanded_` the new state: energies, residual of the whole body, damage history.
  void commit(double imposed, StepRecord& record);

  const Structure& structure_;
  EquilibriumSystem& system_;
  const SolverOptions& options_;
  const DamageParameters parameters_;
  const std::span<const double> ratios_;
  std::vector<std::int64_t> active_;
  std::vector<char> is_active_;
  std::vector<double> history_;    ///< [cell][point]: largest damage so far, secant iterates included
  std::vector<double> committed_;  ///< the same at the last state
  std::vector<double> trial_;      ///< [active cell][point]: damage at `unknowns_`
  State state_, previous_;
  double work_ = 0, dissipated_ = 0;  ///< half body, J

  std::vector<double> unknowns_, force_, residual_, correction_, expanded_;
  std::vector<CellMatrix> matrices_;
  double reaction_ = 0;  ///< at `unknowns_`, half body
};

}  // namespace knothe::offline
