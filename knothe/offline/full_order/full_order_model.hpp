#pragma once
/// @file The full-order model: quasi-static loading of the damageable beam (Rubio et al. 2019, §6.2), by
/// Newton's method.
#include <functional>
#include <memory>
#include <vector>

#include "knothe/offline/full_order/structure.hpp"
#include "knothe/offline/law/damage_law.hpp"
#include "knothe/offline/law/regularisation.hpp"

namespace knothe::offline {

/// Whether what stays elastic is condensed out.
enum class Condensation {
  exact,  ///< unknowns are the dofs of cells that are or may soon be damaged; exact and many times faster
  none    ///< unknowns are all dofs (UMFPACK); for comparison
};

/// How the loading is followed; defaults suit the paper's case.
struct SolverOptions {
  int steps = 100;             ///< equal steps from 0 to `displacement`
  double displacement = 4e-4;  ///< last imposed displacement, m
  /// Newton stops when the out-of-balance nodal forces are below this fraction of the reaction force
  /// (Euclidean norms).
  double tolerance = 1e-10;
  double acceptance = 1e-8;     ///< above this fraction a step is reported as not in equilibrium
  int newton_iterations = 12;   ///< … at most, before the step is cut
  int cuts = 3;                 ///< how often a step is halved before the secant fallback
  int secant_iterations = 400;  ///< at most, in the irreversible secant fallback
  double activation = 0.7;      ///< a cell joins the unknowns when its Y exceeds this fraction of Y₀
  /// Not used with gradient damage, where the averaged strain couples all cells that can be damaged.
  Condensation condensation = Condensation::exact;
  DamageRegularisationOptions regularisation;

  /// Throws ProjectError naming the option that makes no sense.
  void validate() const;
};

/// What one load step came to. Forces and energies are of the whole body (both halves).
struct StepRecord {
  double imposed_displacement = 0;  ///< m
  double reaction_force = 0;        ///< N
  double crack_mouth_opening = 0;   ///< m; 0 if the mesh has no crack mouth
  double external_work = 0;         ///< J, since the start (trapezoidal rule over the accepted increments)
  double stored_energy = 0;         ///< J, ½ ∫ (1 - d) ε:C:ε
  double dissipated_energy =
      0;  ///< J, since the start: Σ ½ ∫ ε_n:C:ε_{n+1} Δd, which balances the work exactly
  double residual = 0;        ///< out-of-balance forces / reaction force, of the whole uncondensed system
  bool equilibrium = true;    ///< residual ≤ SolverOptions::acceptance, in all increments of the step
  int increments = 0;         ///< 1, or more where the step was cut
  int newton_iterations = 0;  ///< linear solves in Newton's method
  int secant_iterations = 0;  ///< linear solves in the fallback
  int active_cells = 0;       ///< cells among the unknowns
  int damaged_points = 0;     ///< Gauss points with d > 0
  std::vector<double> newton_residuals;  ///< relative residuals of the last increment's Newton iterations
};

/// A whole run.
struct FullOrderResult {
  std::vector<double> displacement;  ///< [steps][n_dof], m
  std::vector<StepRecord> steps;
  std::vector<double> cell_damage;  ///< mean d of each cell after the last step; with a crack band that of
                                    ///< the reference law (regularisation.hpp)
  double crack_length = 0;          ///< m, after the last step (regularisation.hpp)
  double cpu_seconds = 0;           ///< of this process

  [[nodiscard]] int newton_iterations() const;
  [[nodiscard]] int secant_iterations() const;
  /// Numbers (from 0) of the steps that are not in equilibrium.
  [[nodiscard]] std::vector<int> steps_without_equilibrium() const;
};

/// Follows the loading for given parameters. Keeps the elastic flexibility it has computed for the next run;
/// what a run gives does not depend on the runs before it.
class FullOrderModel {
 public:
  FullOrderModel(std::shared_ptr<const Structure> structure, SolverOptions options);
  ~FullOrderModel();
  FullOrderModel(FullOrderModel&&) noexcept;
  FullOrderModel& operator=(FullOrderModel&&) noexcept;

  [[nodiscard]] const Structure& structure() const;
  [[nodiscard]] const SolverOptions& options() const;

  /// Runs all steps. `on_step(i)` is called after step i. Throws Interrupted when the user asks to stop. A
  /// step without equilibrium is in the result, and the run goes on.
  [[nodiscard]] FullOrderResult run(const DamageParameters& parameters,
                                    const std::function<void(int)>& on_step = {});

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace knothe::offline
