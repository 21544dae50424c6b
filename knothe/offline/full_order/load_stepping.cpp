#include "knothe/offline/full_order/load_stepping.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/increments.hpp"

namespace knothe::offline {
namespace {

/// Y cannot exceed this: all principal strains positive is the worst case, and (tr ε⁺)² ≤ 3 ε⁺:ε⁺ ≤ 3 ε:ε.
double energy_release_rate_bound(const Voigt& e, double lambda, double mu) {
  const double square =
      e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + 0.5 * (e[3] * e[3] + e[4] * e[4] + e[5] * e[5]);
  return (1.5 * lambda + mu) * square;
}

}  // namespace

LoadStepping::LoadStepping(const Structure& structure, EquilibriumSystem& system,
                           const SolverOptions& options, const DamageParameters& parameters,
                           std::span<const double> ratios)
    : structure_(structure), system_(system), options_(options), parameters_(parameters), ratios_(ratios) {
  const std::size_t cells = structure.mesh().cell_count();
  is_active_.assign(cells, 0);
  history_.assign(cells * k_points_per_cell, 0.0);
  committed_ = history_;
  state_.displacement.assign(structure.dof_count(), 0.0);
  previous_ = state_;
  expanded_ = state_.displacement;
  if (options.condensation == Condensation::none)
    for (std::size_t cell = 0; cell < cells; ++cell)
      if (structure.mesh().elastic[cell] == 0) is_active_[cell] = 1;
  set_active();
}

void LoadStepping::set_active() {
  active_.clear();
  for (Index cell = 0; cell < std::ssize(is_active_); ++cell)
    if (is_active_[cell] != 0) active_.push_back(cell);
  system_.set_active(active_);
  const std::size_t n = system_.unknown_dofs().size();
  unknowns_.resize(n);
  force_.resize(n);
  residual_.resize(n);
  correction_.resize(n);
  matrices_.resize(active_.size());
  trial_.resize(active_.size() * k_points_per_cell);
}

void LoadStepping::gather_unknowns(std::span<const double> displacement) {
  const auto dofs = system_.unknown_dofs();
  for (Index i = 0; i < std::ssize(dofs); ++i) unknowns_[i] = displacement[dofs[i]];
}

void LoadStepping::start_guess(double imposed, bool extrapolate) {
  const double last = state_.imposed - previous_.imposed;
  const double ratio = extrapolate && last > 0 ? (imposed - state_.imposed) / last : 0.0;
  const auto dofs = system_.unknown_dofs();
  for (Index i = 0; i < std::ssize(dofs); ++i) {
    const double now = state_.displacement[dofs[i]];
    unknowns_[i] = now + ratio * (now - previous_.displacement[dofs[i]]);
  }
}

CellVector LoadStepping::cell_displacement(double imposed, std::size_t index,
                                           const std::array<int, k_cell_dofs>& dofs) const {
  const int* places = &system_.places()[k_cell_dofs * index];
  CellVector u;
  for (int i = 0; i < k_cell_dofs; ++i)
    u[i] = places[i] >= 0 ? unknowns_[places[i]] : imposed * structure_.unit_prescribed()[dofs[i]];
  return u;
}

bool LoadStepping::evaluate_cell(std::size_t index, const CellVector& u, Stiffness stiffness,
                                 CellVector& force) {
  const double lambda = structure_.elastic().lambda(), mu = structure_.elastic().mu();
  const std::int64_t cell = active_[index];
  CellMatrix& matrix = matrices_[index];
  matrix.fill(0.0);
  bool damaged = false;
  for (int point = 0; point < k_points_per_cell; ++point) {
    const double* gradient = structure_.elements().gradient(cell, point);
    const Voigt strain = strain_at(gradient, u);
    double d = history_[k_points_per_cell * cell + point];
    VoigtMatrix lost{};  // ∂(d C ε)/∂ε
    const Voigt effective = elastic_stress(strain, lambda, mu);
    if (energy_release_rate_bound(strain, lambda, mu) > parameters_.threshold) {
      const PrincipalStrains principal = principal_strains(strain);
      const BandDamage current =
          band_damage(energy_release_rate(principal, structure_.elastic()), parameters_, ratios_[cell]);
      if (current.damage > d) {
        d = current.damage;
        if (stiffness == Stiffness::tangent) {
          const Voigt derivative = energy_release_rate_derivative(principal, structure_.elastic());
          for (int i = 0; i < 6; ++i)
            for (int j = 0; j < 6; ++j) lost[6 * i + j] = current.slope * effective[i] * derivative[j];
        }
      }
    }
    trial_[k_points_per_cell * index + point] = d;
    if (d == 0) continue;
    damaged = true;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) lost[6 * i + j] += d * (lambda + (i == j ? 2 * mu : 0.0));
      lost[6 * (i + 3) + i + 3] += d * mu;
    }
    Voigt lost_stress;
    for (int i = 0; i < 6; ++i) lost_stress[i] = d * effective[i];
    const double weight = structure_.elements().weight(cell, point);
    add_internal_force(gradient, lost_stress, weight, force);
    add_stiffness(gradient, lost, weight, matrix);
  }
  return damaged;
}

void LoadStepping::evaluate(double imposed, Stiffness stiffness) {
  std::fill(force_.begin(), force_.end(), 0.0);
  reaction_ = imposed * structure_.unit_reaction();
  for (Index index = 0; index < std::ssize(active_); ++index) {
    const auto dofs = structure_.cell_dofs(active_[index]);
    const CellVector u = cell_displacement(imposed, index, dofs);
    CellVector force{};
    if (!evaluate_cell(index, u, stiffness, force)) continue;
    const int* places = &system_.places()[k_cell_dofs * index];
    for (int i = 0; i < k_cell_dofs; ++i) {
      if (places[i] >= 0) force_[places[i]] += force[i];
      reaction_ -= structure_.unit_lift()[dofs[i]] * force[i];  // virtual work in the unit lift
    }
  }
}

double LoadStepping::relative_residual(double imposed) {
  system_.residual(imposed, unknowns_, force_, residual_);
  return norm(residual_) / force_scale(reaction_, imposed);
}

double LoadStepping::force_scale(double reaction, double imposed) const {
  // A fully broken body has no reaction left; its elastic one keeps the scale from vanishing.
  return std::max(std::abs(reaction), 1e-5 * std::abs(imposed) * structure_.unit_reaction());
}

bool LoadStepping::newton_iterations(double imposed, StepRecord& record) {
  record.newton_residuals.clear();
  while (true) {
    evaluate(imposed, Stiffness::tangent);
    record.newton_residuals.push_back(relative_residual(imposed));
    const NewtonVerdict verdict = newton_verdict(record.newton_residuals, options_);
    if (verdict != NewtonVerdict::go_on) return verdict == NewtonVerdict::converged;
    ++record.newton_iterations;
    if (!system_.solve(matrices_, residual_, correction_)) return false;
    for (Index i = 0; i < std::ssize(unknowns_); ++i) unknowns_[i] -= correction_[i];
  }
}

bool LoadStepping::newton(double imposed, StepRecord& record) {
  while (newton_iterations(imposed, record)) {
    system_.expand(imposed, unknowns_, force_, expanded_);
    if (!activate(1.0)) return true;
    gather_unknowns(expanded_);
  }
  return false;
}

bool LoadStepping::secant(double imposed, StepRecord& record) {
  constexpr int k_before_newton = 10;
  for (int iteration = 1; iteration <= options_.secant_iterations; ++iteration) {
    evaluate(imposed, Stiffness::secant);
    store_trial_damage(history_);
    const double relative = relative_residual(imposed);
    if (relative <= options_.tolerance || iteration % k_before_newton == 0) {
      const std::vector<double> start = unknowns_;
      const std::size_t cells = active_.size();
      if (newton(imposed, record)) return true;
      if (active_.size() == cells)
        unknowns_ = start;  // Newton ran away: go on from before
      else
        gather_unknowns(expanded_);
      evaluate(imposed, Stiffness::secant);
      store_trial_damage(history_);
      if (!std::isfinite(relative_residual(imposed))) return false;
    }
    ++record.secant_iterations;
    if (!system_.solve(matrices_, residual_, correction_)) return false;
    for (Index i = 0; i < std::ssize(unknowns_); ++i) unknowns_[i] -= correction_[i];
    // Cells that the growing damage loads beyond their threshold must join at once.
    if (iteration % k_before_newton == 5) {
      evaluate(imposed, Stiffness::secant);
      system_.expand(imposed, unknowns_, force_, expanded_);
      if (activate(1.0)) gather_unknowns(expanded_);
    }
  }
  return false;
}

bool LoadStepping::activate(double trigger) {
  const double lambda = structure_.elastic().lambda(), mu = structure_.elastic().mu();
  bool triggered = false;
  std::vector<std::int64_t> joining;
  for (std::int64_t cell = 0; cell < structure_.mesh().cell_count(); ++cell) {
    if (is_active_[cell] != 0 || structure_.mesh().elastic[cell] != 0) continue;
    const CellVector u = structure_.gather(expanded_, cell);
    double largest = 0;
    for (int point = 0; point < k_points_per_cell; ++point) {
      const Voigt strain = strain_at(structure_.elements().gradient(cell, point), u);
      if (energy_release_rate_bound(strain, lambda, mu) > options_.activation * parameters_.threshold)
        largest = std::max(largest, energy_release_rate(strain, structure_.elastic()));
    }
    if (largest > options_.activation * parameters_.threshold) joining.push_back(cell);
    triggered = triggered || largest > trigger * parameters_.threshold;
  }
  if (!triggered || joining.empty()) return false;
  for (const auto cell : joining) is_active_[cell] = 1;
  set_active();
  return true;
}

void LoadStepping::store_trial_damage(std::vector<double>& damage) const {
  for (Index index = 0; index < std::ssize(active_); ++index)
    std::copy_n(&trial_[k_points_per_cell * index], k_points_per_cell,
                &damage[k_points_per_cell * active_[index]]);
}

void LoadStepping::commit(double imposed, StepRecord& record) {
  const double lambda = structure_.elastic().lambda(), mu = structure_.elastic().mu();
  store_trial_damage(history_);
  std::vector<double> elastic_force(structure_.dof_count());
  structure_.stiffness().multiply(expanded_, elastic_force);
  double stored = 0.5 * dot(expanded_, elastic_force);
  double dissipated = 0;
  record.damaged_points = 0;
  for (const auto cell : active_) {
    const CellVector now = structure_.gather(expanded_, cell),
                     before = structure_.gather(state_.displacement, cell);
    CellVector force{};
    for (int point = 0; point < k_points_per_cell; ++point) {
      const std::size_t place = k_points_per_cell * cell + point;
      const double d = history_[place];
      if (d == 0) continue;
      ++record.damaged_points;
      const double* gradient = structure_.elements().gradient(cell, point);
      const double weight = structure_.elements().weight(cell, point);
      const Voigt strain = strain_at(gradient, now);
      const Voigt effective = elastic_stress(strain, lambda, mu);
      Voigt lost;
      for (int i = 0; i < 6; ++i) lost[i] = d * effective[i];
      add_internal_force(gradient, lost, weight, force);
      stored -= 0.5 * weight * dot(lost, strain);
      dissipated += 0.5 * weight * dot(effective, strain_at(gradient, before)) * (d - committed_[place]);
    }
    const auto dofs = structure_.cell_dofs(cell);
    for (int i = 0; i < k_cell_dofs; ++i) elastic_force[dofs[i]] -= force[i];
  }
  double square = 0, reaction = 0;
  for (int dof = 0; dof < structure_.dof_count(); ++dof) {
    if (structure_.free_index(dof) >= 0) square += elastic_force[dof] * elastic_force[dof];
    reaction += structure_.unit_prescribed()[dof] * elastic_force[dof];
  }
  committed_ = history_;
  work_ += 0.5 * (reaction + state_.reaction) * (imposed - state_.imposed);
  dissipated_ += dissipated;
  previous_ = state_;
  state_.imposed = imposed;
  state_.displacement = expanded_;
  state_.reaction = reaction;

  add_increment({imposed, reaction, work_, stored, dissipated_},
                std::sqrt(square) / force_scale(reaction, imposed), options_.acceptance, record);
}

StepRecord LoadStepping::advance(double target) {
  StepRecord record;
  advance_by_increments(
      state_.imposed, target, options_.cuts,
      [&](double next) {
        start_guess(next, true);
        return newton(next, record);
      },
      [&](double next) {
        start_guess(next, false);
        if (secant(next, record)) return;
        // Not in equilibrium: keep the last iterate, or the last state if the iterate is not finite, and
        // report it.
        if (!std::isfinite(norm(unknowns_))) start_guess(next, false);
        evaluate(next, Stiffness::secant);
        system_.expand(next, unknowns_, force_, expanded_);
      },
      [&](double next) {
        commit(next, record);
        (void)activate(options_.activation);
      });
  record.active_cells = active_.size();
  record.crack_mouth_opening = crack_mouth_opening(structure_, state_.displacement);
  return record;
}

std::vector<double> LoadStepping::cell_damage() const {
  std::vector<double> mean(is_active_.size(), 0.0);
  for (Index cell = 0; cell < std::ssize(mean); ++cell)
    for (int point = 0; point < k_points_per_cell; ++point)
      mean[cell] +=
          reference_damage(committed_[k_points_per_cell * cell + point], ratios_[cell]) / k_points_per_cell;
  return mean;
}

}  // namespace knothe::offline
