#include "knothe/offline/full_order/gradient_stepping.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/increments.hpp"

namespace knothe::offline {
namespace {

constexpr int k_min_cuts = 7;  // its secant iterations cost more than more halvings
constexpr int k_newton_iterations = 15;

/// Y of an averaged equivalent strain.
double rate_of(double strain, double young_modulus) {
  return strain > 0 ? 0.5 * young_modulus * strain * strain : 0.0;
}

}  // namespace

GradientStepping::GradientStepping(const Structure& structure, const SolverOptions& options,
                                   const DamageParameters& parameters)
    : structure_(structure),
      options_(options),
      parameters_(parameters),
      solver_([this]() -> const SparseMatrix& {
        number();
        assemble_base();
        return base_;
      }()) {
  tangent_ = base_;
  history_.assign(cells_.size() * k_points_per_cell, 0.0);
  committed_ = trial_ = history_;
  state_.unknowns.assign(unknown_count(), 0.0);
  state_.displacement.assign(structure.dof_count(), 0.0);
  previous_ = state_;
  unknowns_ = residual_ = correction_ = state_.unknowns;
  displacement_ = force_ = state_.displacement;
}

void GradientStepping::number() {
  const auto& mesh = structure_.mesh();
  std::vector<int> average(mesh.node_count(), -1);
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    if (mesh.elastic[cell] != 0) continue;
    cells_.push_back(cell);
    for (const int dof : structure_.cell_dofs(cell)) places_.push_back(structure_.free_index(dof));
    for (int a = 0; a < k_nodes_per_cell; ++a) {
      int& place = average[mesh.cells[8 * cell + a]];
      if (place < 0) place = average_count_++;
      places_.push_back(structure_.free_count() + place);
    }
  }
}

void GradientStepping::assemble_base() {
  // The pattern: elastic cells couple their dofs alone.
  const auto& mesh = structure_.mesh();
  std::vector<int> lists = places_;
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    if (mesh.elastic[cell] == 0) continue;
    for (const int dof : structure_.cell_dofs(cell)) lists.push_back(structure_.free_index(dof));
    lists.insert(lists.end(), k_nodes_per_cell, -1);
  }
  base_ = coupling_pattern(unknown_count(), lists, k_cell_unknowns);
  const SparseMatrix& elastic = structure_.free_stiffness();
  for (int row = 0; row < elastic.rows(); ++row)
    for (int k = elastic.row_start[row]; k < elastic.row_start[row + 1]; ++k)
      base_.value[base_.position(row, elastic.column[k])] = elastic.value[k];

  positions_.assign(cells_.size() * k_cell_unknowns * k_cell_unknowns, -1);
  const double modulus = structure_.elastic().young_modulus;
  const double square = std::pow(options_.regularisation.internal_length, 2);
  for (Index index = 0; index < std::ssize(cells_); ++index) {
    const int* places = &places_[k_cell_unknowns * index];
    int* positions = &positions_[k_cell_unknowns * k_cell_unknowns * index];
    for (int i = 0; i < k_cell_unknowns; ++i)
      for (int j = 0; j < k_cell_unknowns; ++j)
        if (places[i] >= 0 && places[j] >= 0)
          positions[k_cell_unknowns * i + j] = base_.position(places[i], places[j]);
    for (int point = 0; point < k_points_per_cell; ++point) {
      const double* value = structure_.elements().value(cells_[index], point);
      const double* gradient = structure_.elements().gradient(cells_[index], point);
      const double weight = modulus * structure_.elements().weight(cells_[index], point);
      for (int a = 0; a < k_nodes_per_cell; ++a)
        for (int b = 0; b < k_nodes_per_cell; ++b) {
          double sum = value[a] * value[b];
          for (int c = 0; c < 3; ++c) sum += square * gradient[8 * c + a] * gradient[8 * c + b];
          base_.value[positions[k_cell_unknowns * (k_cell_dofs + a) + k_cell_dofs + b]] += weight * sum;
        }
    }
  }
}

void GradientStepping::evaluate_cell(std::size_t index, Stiffness stiffness) {
  const ElasticConstants& elastic = structure_.elastic();
  const double lambda = elastic.lambda(), mu = elastic.mu(), modulus = elastic.young_modulus;
  const double square = std::pow(options_.regularisation.internal_length, 2);
  const std::int64_t cell = cells_[index];
  const int* places = &places_[k_cell_unknowns * index];
  const CellVector u = structure_.gather(displacement_, cell);
  std::array<double, k_nodes_per_cell> average;
  for (int a = 0; a < k_nodes_per_cell; ++a) average[a] = unknowns_[places[k_cell_dofs + a]];

  CellMatrix stiffness_lost{};
  CellVector force{};
  double coupling[k_cell_dofs][k_nodes_per_cell] = {}, source[k_nodes_per_cell][k_cell_dofs] = {};
  std::array<double, k_nodes_per_cell> balance{};
  for (int point = 0; point < k_points_per_cell; ++point) {
    const double* gradient = structure_.elements().gradient(cell, point);
    const double* value = structure_.elements().value(cell, point);
    const double weight = structure_.elements().weight(cell, point);
    const Voigt strain = strain_at(gradient, u);
    const PrincipalStrains principal = principal_strains(strain);
    const double e = std::sqrt(2 * energy_release_rate(principal, elastic) / modulus);
    double mean = 0;
    std::array<double, 3> slope{};
    for (int a = 0; a < k_nodes_per_cell; ++a) {
      mean += value[a] * average[a];
      for (int c = 0; c < 3; ++c) slope[c] += gradient[8 * c + a] * average[a];
    }
    average_scale_ += modulus * weight * e;
    for (int a = 0; a < k_nodes_per_cell; ++a) {
      double sum = value[a] * (mean - e);
      for (int c = 0; c < 3; ++c) sum += square * gradient[8 * c + a] * slope[c];
      balance[a] += modulus * weight * sum;
    }
    const std::size_t place = k_points_per_cell * index + point;
    const double kappa = std::max(mean, history_[place]);
    const double d = damage(rate_of(kappa, modulus), parameters_);
    trial_[place] = kappa;
    const Voigt effective = elastic_stress(strain, lambda, mu);
    if (e > 1e-14) {  // ∂e/∂ε = ∂Y/∂ε / (E e)
      CellVector change{};
      add_internal_force(gradient, energy_release_rate_derivative(principal, elastic), weight / e, change);
      for (int a = 0; a < k_nodes_per_cell; ++a)
        for (int j = 0; j < k_cell_dofs; ++j) source[a][j] += value[a] * change[j];
    }
    if (d == 0) continue;
    Voigt lost_stress;
    for (int i = 0; i < 6; ++i) lost_stress[i] = d * effective[i];
    add_internal_force(gradient, lost_stress, weight, force);
    VoigtMatrix lost{};
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) lost[6 * i + j] = d * (lambda + (i == j ? 2 * mu : 0.0));
      lost[6 * (i + 3) + i + 3] = d * mu;
    }
    add_stiffness(gradient, lost, weight, stiffness_lost);
    if (stiffness == Stiffness::tangent && mean > history_[place]) {
      const double factor = weight * parameters_.brittleness * (1 - d) * (1 - d) * modulus * kappa;
      CellVector stress_force{};
      add_internal_force(gradient, effective, factor, stress_force);
      for (int i = 0; i < k_cell_dofs; ++i)
        for (int a = 0; a < k_nodes_per_cell; ++a) coupling[i][a] += stress_force[i] * value[a];
    }
  }

  const auto dofs = structure_.cell_dofs(cell);
  for (int i = 0; i < k_cell_dofs; ++i) force_[dofs[i]] -= force[i];
  for (int a = 0; a < k_nodes_per_cell; ++a) residual_[places[k_cell_dofs + a]] += balance[a];
  const int* positions = &positions_[k_cell_unknowns * k_cell_unknowns * index];
  const auto subtract = [&](int i, int j, double amount) {
    const int position = positions[k_cell_unknowns * i + j];
    if (position >= 0) tangent_.value[position] -= amount;
  };
  for (int i = 0; i < k_cell_dofs; ++i) {
    for (int j = 0; j < k_cell_dofs; ++j) subtract(i, j, stiffness_lost[k_cell_dofs * i + j]);
    for (int a = 0; a < k_nodes_per_cell; ++a) {
      subtract(i, k_cell_dofs + a, coupling[i][a]);
      subtract(k_cell_dofs + a, i, source[a][i]);
    }
  }
}

void GradientStepping::evaluate(double imposed, Stiffness stiffness) {
  for (int dof = 0; dof < structure_.dof_count(); ++dof) {
    const int free = structure_.free_index(dof);
    displacement_[dof] = free >= 0 ? unknowns_[free] : imposed * structure_.unit_prescribed()[dof];
  }
  structure_.stiffness().multiply(displacement_, force_);
  std::fill(residual_.begin(), residual_.end(), 0.0);
  tangent_.value = base_.value;
  average_scale_ = 0;
  for (Index index = 0; index < std::ssize(cells_); ++index) evaluate_cell(index, stiffness);
  for (int i = 0; i < structure_.free_count(); ++i) residual_[i] = force_[structure_.free_dofs()[i]];
  reaction_ = dot(force_, structure_.unit_prescribed());
}

void GradientStepping::linearise(double imposed, std::span<const double> unknowns) {
  unknowns_.assign(unknowns.begin(), unknowns.end());
  evaluate(imposed, Stiffness::tangent);
}

double GradientStepping::force_scale(double imposed) const {
  return std::max(std::abs(reaction_), 1e-5 * std::abs(imposed) * structure_.unit_reaction());
}

double GradientStepping::relative_residual(double imposed) const {
  const std::size_t free = structure_.free_count();
  const double forces = norm(std::span(residual_).first(free)) / force_scale(imposed);
  const double average = norm(std::span(residual_).subspan(free)) / std::max(average_scale_, 1e-300);
  return std::max(forces, average);
}

bool GradientStepping::newton(double imposed, StepRecord& record) {
  record.newton_residuals.clear();
  double last = 0;
  for (int iteration = 0; iteration <= k_newton_iterations; ++iteration) {
    evaluate(imposed, Stiffness::tangent);
    const double relative = relative_residual(imposed);
    record.newton_residuals.push_back(relative);
    if (!std::isfinite(relative)) return false;
    if (relative <= options_.tolerance) return true;
    if (iteration > 0 && relative <= 0.1 * options_.acceptance && relative > 0.25 * last) return true;
    if (iteration > 2 && relative > 1e3 * record.newton_residuals.front()) return false;
    last = relative;
    if (iteration == k_newton_iterations) break;
    ++record.newton_iterations;
    if (!solver_.solve(tangent_, residual_, correction_)) return false;
    for (Index i = 0; i < std::ssize(unknowns_); ++i) unknowns_[i] -= correction_[i];
  }
  return false;
}

bool GradientStepping::secant(double imposed, StepRecord& record) {
  // Irreversible: the averaged strain that an iterate reaches stays, so the sequence is monotone.
  for (int iteration = 1; iteration <= options_.secant_iterations; ++iteration) {
    evaluate(imposed, Stiffness::secant);
    history_ = trial_;
    if (!std::isfinite(relative_residual(imposed))) return false;
    if (iteration % 10 == 0) {
      const std::vector<double> start = unknowns_;
      if (newton(imposed, record)) return true;
      unknowns_ = start;
      evaluate(imposed, Stiffness::secant);
    }
    ++record.secant_iterations;
    if (!solver_.solve(tangent_, residual_, correction_)) return false;
    for (Index i = 0; i < std::ssize(unknowns_); ++i) unknowns_[i] -= correction_[i];
  }
  return false;
}

void GradientStepping::commit(double imposed, StepRecord& record) {
  const ElasticConstants& elastic = structure_.elastic();
  history_ = trial_;
  std::vector<double> elastic_force(displacement_.size());
  structure_.stiffness().multiply(displacement_, elastic_force);
  double stored = 0.5 * dot(displacement_, elastic_force);
  double dissipated = 0;
  record.damaged_points = 0;
  for (Index index = 0; index < std::ssize(cells_); ++index) {
    const CellVector now = structure_.gather(displacement_, cells_[index]);
    const CellVector before = structure_.gather(state_.displacement, cells_[index]);
    for (int point = 0; point < k_points_per_cell; ++point) {
      const std::size_t place = k_points_per_cell * index + point;
      const double d = damage(rate_of(history_[place], elastic.young_modulus), parameters_);
      if (d == 0) continue;
      ++record.damaged_points;
      const double last = damage(rate_of(committed_[place], elastic.young_modulus), parameters_);
      const double* gradient = structure_.elements().gradient(cells_[index], point);
      const double weight = structure_.elements().weight(cells_[index], point);
      const Voigt strain = strain_at(gradient, now);
      const Voigt effective = elastic_stress(strain, elastic.lambda(), elastic.mu());
      stored -= 0.5 * weight * d * dot(effective, strain);
      dissipated += 0.5 * weight * dot(effective, strain_at(gradient, before)) * (d - last);
    }
  }
  committed_ = history_;
  work_ += 0.5 * (reaction_ + state_.reaction) * (imposed - state_.imposed);
  dissipated_ += dissipated;
  previous_ = state_;
  state_ = {imposed, unknowns_, displacement_, reaction_};

  add_increment({imposed, reaction_, work_, stored, dissipated_}, relative_residual(imposed),
                options_.acceptance, record);
}

void GradientStepping::extrapolate(double imposed) {
  const double last = state_.imposed - previous_.imposed;
  const double ratio = last > 0 ? (imposed - state_.imposed) / last : 0.0;
  for (Index i = 0; i < std::ssize(unknowns_); ++i)
    unknowns_[i] = state_.unknowns[i] + ratio * (state_.unknowns[i] - previous_.unknowns[i]);
}

StepRecord GradientStepping::advance(double target) {
  StepRecord record;
  record.active_cells = cells_.size();
  advance_by_increments(
      state_.imposed, target, std::max(options_.cuts, k_min_cuts),
      [&](double next) {
        extrapolate(next);
        return newton(next, record);
      },
      [&](double next) {
        unknowns_ = state_.unknowns;
        if (secant(next, record)) return;
        // Not in equilibrium: keep the last iterate, or the last state if it is not finite, and report it.
        if (!std::isfinite(norm(unknowns_))) unknowns_ = state_.unknowns;
        evaluate(next, Stiffness::secant);
      },
      [&](double next) { commit(next, record); });
  record.crack_mouth_opening = crack_mouth_opening(structure_, state_.displacement);
  return record;
}

std::vector<double> GradientStepping::cell_damage() const {
  std::vector<double> mean(structure_.mesh().cell_count(), 0.0);
  for (Index index = 0; index < std::ssize(cells_); ++index)
    for (int point = 0; point < k_points_per_cell; ++point)
      mean[cells_[index]] +=
          damage(rate_of(committed_[k_points_per_cell * index + point], structure_.elastic().young_modulus),
                 parameters_) /
          k_points_per_cell;
  return mean;
}

}  // namespace knothe::offline
