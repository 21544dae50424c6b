#include "knothe/mechanics/increments.hpp"

#include <algorithm>

namespace knothe::mechanics {

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
  return displacement[3 * static_cast<std::size_t>(mesh.mouth_right)] -
         displacement[3 * static_cast<std::size_t>(mesh.mouth_left)];
}

}  // namespace knothe::mechanics
