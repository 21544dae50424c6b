#include "knothe/offline/full_order/increments.hpp"

#include <algorithm>
#include <cmath>

namespace knothe::offline {

NewtonVerdict newton_verdict(std::span<const double> residuals, const SolverOptions& options) {
  const double now = residuals.back();
  const int iteration = residuals.size() - 1;
  if (!std::isfinite(now)) return NewtonVerdict::failed;
  if (now <= options.tolerance) return NewtonVerdict::converged;
  const std::span before = residuals.first(residuals.size() - 1);
  if (iteration > 0 && now <= 0.1 * options.acceptance && now > 0.25 * before.back())
    return NewtonVerdict::converged;
  if (iteration > 3 && now > 1e3 * *std::min_element(before.begin(), before.end()))
    return NewtonVerdict::failed;
  return iteration == options.newton_iterations ? NewtonVerdict::failed : NewtonVerdict::go_on;
}

void add_increment(const HalfBody& half, double residual, double acceptance, StepRecord& record) {
  record.residual = std::max(record.residual, residual);
  record.equilibrium = record.equilibrium && residual <= acceptance;
  record.imposed_displacement = half.imposed;
  record.reaction_force = 2 * half.reaction;
  record.external_work = 2 * half.work;
  record.stored_energy = 2 * half.stored;
  record.dissipated_energy = 2 * half.dissipated;
  ++record.increments;
}

double crack_mouth_opening(const Structure& structure, std::span<const double> displacement) {
  const auto& mesh = structure.mesh();
  if (mesh.mouth_left < 0 || mesh.mouth_right < 0) return 0;
  return displacement[3 * mesh.mouth_right] - displacement[3 * mesh.mouth_left];
}

}  // namespace knothe::offline
