#include "knothe/offline/distributed/distributed_body.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/increments.hpp"

namespace knothe::offline {
namespace {

constexpr double k_linear_tolerance = 1e-5;  ///< of a Newton correction
constexpr int k_max_linear_iterations = 400;
constexpr int k_many_linear_iterations = 40;  ///< more: the multigrid is made again

}  // namespace

CellVector DistributedBody::gather(std::span<const double> values, std::int64_t cell) const {
  CellVector u;
  const std::int64_t* nodes = &part.mesh.cells[8 * cell];
  for (int a = 0; a < k_nodes_per_cell; ++a)
    for (int c = 0; c < 3; ++c) u[8 * c + a] = values[3 * nodes[a] + c];
  return u;
}

void DistributedBody::scatter(const CellVector& values, std::int64_t cell, std::span<double> sum) const {
  const std::int64_t* nodes = &part.mesh.cells[8 * cell];
  for (int a = 0; a < k_nodes_per_cell; ++a)
    for (int c = 0; c < 3; ++c) sum[3 * nodes[a] + c] += values[8 * c + a];
}

void DistributedBody::secant_matrix(std::int64_t cell, std::span<const double> damage,
                                    CellMatrix& matrix) const {
  matrix.fill(0.0);
  const VoigtMatrix c = elastic_matrix(elastic);
  for (int point = 0; point < k_points_per_cell; ++point)
    add_stiffness(elements.gradient(cell, point), c,
                  elements.weight(cell, point) * (damage.empty() ? 1.0 : 1.0 - damage[point]), matrix);
}

double DistributedBody::free_norm(std::span<const double> force) const {
  double square = 0;
  for (std::size_t dof = 0; dof < owned_dofs(); ++dof)
    if (prescribed[dof] == 0) square += force[dof] * force[dof];
  return std::sqrt(ranks.sum(square));
}

double DistributedBody::reaction(std::span<const double> force) const {
  return ranks.sum(
      std::inner_product(force.begin(), force.begin() + owned_dofs(), unit_prescribed.begin(), 0.0));
}

DistributedStepping::DistributedStepping(DistributedBody& body, const SolverOptions& options,
                                         const DamageParameters& parameters, std::span<const double> ratios)
    : body_(body), options_(options), parameters_(parameters), ratios_(ratios) {
  history_.assign(body.part.mesh.cell_count() * k_points_per_cell, 0.0);
  committed_ = trial_ = history_;
  displacement_.assign(body.unit_lift.size(), 0.0);
  force_ = correction_ = displacement_;
  state_.displacement = displacement_;
  previous_ = state_;
}

MaterialResponse DistributedStepping::respond_at(std::int64_t cell, int point, const CellVector& u) const {
  const Voigt strain = strain_at(body_.elements.gradient(cell, point), u);
  if (body_.part.mesh.elastic[cell] != 0) {
    MaterialResponse response;
    response.stress = elastic_stress(strain, body_.elastic.lambda(), body_.elastic.mu());
    response.tangent = elastic_matrix(body_.elastic);
    return response;
  }
  return respond(strain, history_[k_points_per_cell * cell + point], body_.elastic, parameters_,
                 ratios_[cell]);
}

double DistributedStepping::evaluate(double imposed) {
  std::fill(force_.begin(), force_.end(), 0.0);
  for (std::int64_t cell = 0; cell < body_.part.mesh.cell_count(); ++cell) {
    const CellVector u = body_.gather(displacement_, cell);
    CellVector force{};
    for (int point = 0; point < k_points_per_cell; ++point) {
      const MaterialResponse response = respond_at(cell, point, u);
      trial_[k_points_per_cell * cell + point] = response.damage;
      add_internal_force(body_.elements.gradient(cell, point), response.stress,
                         body_.elements.weight(cell, point), force);
    }
    body_.scatter(force, cell, force_);
  }
  reaction_ = body_.reaction(force_);
  return body_.free_norm(force_) /
         std::max(std::abs(reaction_), 1e-5 * std::abs(imposed) * body_.unit_reaction);
}

void DistributedStepping::prepare_secant() {
  body_.system->set_symmetric([&](std::int64_t cell, CellMatrix& matrix) {
    body_.secant_matrix(cell, std::span(trial_).subspan(k_points_per_cell * cell, 8), matrix);
  });
  preconditioner_is_old_ = false;
}

/// Solves for the correction and makes it.
bool DistributedStepping::correct() {
  right_.assign(force_.begin(), force_.begin() + body_.owned_dofs());
  for (Index dof = 0; dof < std::ssize(right_); ++dof)
    if (body_.prescribed[dof] != 0) right_[dof] = 0;
  const LinearSolve solve =
      body_.system->solve(right_, correction_, k_linear_tolerance, k_max_linear_iterations);
  preconditioner_is_old_ = preconditioner_is_old_ || solve.iterations > k_many_linear_iterations;
  // A correction that is not converged may still help; one that is worse than none is not made.
  if (!(solve.residual < 0.5)) return false;
  for (std::size_t dof = 0; dof < body_.owned_dofs(); ++dof) displacement_[dof] -= correction_[dof];
  body_.system->update_ghosts(displacement_);
  return true;
}

bool DistributedStepping::newton(double imposed, StepRecord& record) {
  record.newton_residuals.clear();
  while (true) {
    record.newton_residuals.push_back(evaluate(imposed));
    const NewtonVerdict verdict = newton_verdict(record.newton_residuals, options_);
    if (verdict != NewtonVerdict::go_on) return verdict == NewtonVerdict::converged;
    ++record.newton_iterations;
    if (preconditioner_is_old_) prepare_secant();
    body_.system->set_general([&](std::int64_t cell, CellMatrix& matrix) {
      matrix.fill(0.0);
      const CellVector u = body_.gather(displacement_, cell);
      for (int point = 0; point < k_points_per_cell; ++point)
        add_stiffness(body_.elements.gradient(cell, point), respond_at(cell, point, u).tangent,
                      body_.elements.weight(cell, point), matrix);
    });
    if (!correct()) return false;
  }
}

bool DistributedStepping::secant(double imposed, StepRecord& record) {
  // Irreversible: the damage that an iterate reaches stays, so the sequence is monotone.
  for (int iteration = 1; iteration <= options_.secant_iterations; ++iteration) {
    const double relative = evaluate(imposed);
    history_ = trial_;
    if (!std::isfinite(relative)) return false;
    if (relative <= options_.tolerance || iteration % 10 == 0) {
      const std::vector<double> start = displacement_;
      if (newton(imposed, record)) return true;
      displacement_ = start;
      (void)evaluate(imposed);
    }
    ++record.secant_iterations;
    prepare_secant();
    if (!correct()) return false;
  }
  return false;
}

void DistributedStepping::start_guess(double imposed, bool extrapolate) {
  const double last = state_.imposed - previous_.imposed;
  const double step = imposed - state_.imposed;
  for (Index dof = 0; dof < std::ssize(displacement_); ++dof) {
    const double now = state_.displacement[dof];
    // The elastic solution for the increment, or the line through the last two states.
    displacement_[dof] = extrapolate && last > 0 ? now + step / last * (now - previous_.displacement[dof])
                                                 : now + step * body_.unit_lift[dof];
  }
}

void DistributedStepping::commit(double imposed, StepRecord& record) {
  const double residual = evaluate(imposed);
  const double lambda = body_.elastic.lambda(), mu = body_.elastic.mu();
  history_ = trial_;
  std::array<double, 3> sums{};  // stored, dissipated, damaged points
  for (std::int64_t cell = 0; cell < body_.part.owned_cells; ++cell) {
    const CellVector now = body_.gather(displacement_, cell),
                     before = body_.gather(state_.displacement, cell);
    for (int point = 0; point < k_points_per_cell; ++point) {
      const std::size_t place = k_points_per_cell * cell + point;
      const double* gradient = body_.elements.gradient(cell, point);
      const double weight = body_.elements.weight(cell, point), d = history_[place];
      const Voigt strain = strain_at(gradient, now);
      const Voigt effective = elastic_stress(strain, lambda, mu);
      sums[0] += 0.5 * weight * (1 - d) * dot(effective, strain);
      if (d == 0) continue;
      sums[1] += 0.5 * weight * dot(effective, strain_at(gradient, before)) * (d - committed_[place]);
      sums[2] += 1;
    }
  }
  body_.ranks.sum(sums.data(), sums.size());
  record.damaged_points = sums[2];
  committed_ = history_;
  work_ += 0.5 * (reaction_ + state_.reaction) * (imposed - state_.imposed);
  dissipated_ += sums[1];
  previous_ = state_;
  state_ = {imposed, displacement_, reaction_};
  add_increment({imposed, reaction_, work_, sums[0], dissipated_}, residual, options_.acceptance, record);
}

StepRecord DistributedStepping::advance(double target) {
  StepRecord record;
  advance_by_increments(
      state_.imposed, target, options_.cuts,
      [&](double next) {
        start_guess(next, true);
        preconditioner_is_old_ = true;
        return newton(next, record);
      },
      [&](double next) {
        start_guess(next, false);
        if (secant(next, record)) return;
        // Not in equilibrium: keep the last iterate, or the last state if it is not finite, and report it.
        if (!std::isfinite(evaluate(next))) start_guess(next, false);
      },
      [&](double next) { commit(next, record); });
  const HexahedronMesh& mesh = body_.part.mesh;
  double opening = 0;  // each mouth node is on one rank
  if (mesh.mouth_right >= 0) opening += state_.displacement[3 * mesh.mouth_right];
  if (mesh.mouth_left >= 0) opening -= state_.displacement[3 * mesh.mouth_left];
  record.crack_mouth_opening = body_.ranks.sum(opening);
  return record;
}

std::vector<double> DistributedStepping::cell_damage() const {
  std::vector<double> mean(body_.part.mesh.cell_count(), 0.0);
  for (Index cell = 0; cell < std::ssize(mean); ++cell)
    for (int point = 0; point < k_points_per_cell; ++point)
      mean[cell] +=
          reference_damage(committed_[k_points_per_cell * cell + point], ratios_[cell]) / k_points_per_cell;
  return mean;
}

}  // namespace knothe::offline
