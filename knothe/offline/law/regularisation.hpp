#pragma once
/// @file What makes the softening law independent of the mesh: crack band or implicit gradient
/// (docs/explanation/mechanics.md).
#include <span>
#include <vector>

#include "knothe/offline/full_order/finite_elements.hpp"
#include "knothe/offline/law/damage_law.hpp"
#include "knothe/offline/mesh/hexahedron_mesh.hpp"
#include "knothe/project/offline_options.hpp"

namespace knothe::offline {

using project::DamageRegularisation;

struct DamageRegularisationOptions {
  DamageRegularisation kind = DamageRegularisation::none;
  double reference_size = 0.005;  ///< m, crack band: the element size that the law's parameters belong to
  double internal_length = 0.01;  ///< m, gradient: ℓ

  /// Throws ProjectError: both lengths must be positive.
  void validate() const;
};

/// Width of the band of a crack across the beam's axis that runs through a cell: 2 / Σ_a |∂N_a/∂x| with mean
/// gradients (Oliver 1989), for a brick its edge along x. m.
[[nodiscard]] double band_width(const FiniteElements& elements, std::int64_t cell);

/// r of each cell (`band_damage`): reference size / band width with a crack band, else 1.
[[nodiscard]] std::vector<double> band_ratios(const HexahedronMesh& mesh, const FiniteElements& elements,
                                              const DamageRegularisationOptions& options);

/// Throws ProjectError if a cell that can be damaged is too large for the crack band at these parameters
/// (`smallest_band_ratio`): says the largest size that would do.
void check_band(const HexahedronMesh& mesh, const DamageRegularisationOptions& options,
                std::span<const double> ratios, const DamageParameters& parameters);

/// Height of the crack above the notch, m: how far the mean reference damage of the rows of cells (the
/// largest of each row) exceeds ½, linear between the rows' centres. `damage` is that of the reference law,
/// per cell. 0 if no row does. For structured meshes of the beam.
[[nodiscard]] double crack_length(const HexahedronMesh& mesh, const FiniteElements& elements,
                                  std::span<const double> damage);

}  // namespace knothe::offline
