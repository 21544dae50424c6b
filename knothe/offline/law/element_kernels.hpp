#pragma once
/// @file The element loops where the time goes. Displacements and matrices of a cell are ordered component by
/// component: index 8 c + a is component c of the cell's node a.
#include <array>

#include "knothe/offline/law/damage_law.hpp"

namespace knothe::offline {

constexpr int k_cell_dofs = 24;
using CellVector = std::array<double, k_cell_dofs>;
using CellMatrix = std::array<double, k_cell_dofs * k_cell_dofs>;  ///< row-major

/// Strain at a Gauss point from `gradient` [component][node] and the cell's displacements.
[[nodiscard]] Voigt strain_at(const double* gradient, const CellVector& displacement);

/// vector += weight Bᵀ stress.
void add_internal_force(const double* gradient, const Voigt& stress, double weight, CellVector& vector);

/// matrix += weight Bᵀ D B, for any 6 × 6 D.
void add_stiffness(const double* gradient, const VoigtMatrix& material, double weight, CellMatrix& matrix);

/// Elasticity tensor C as a 6 × 6 matrix for engineering shear strains.
[[nodiscard]] VoigtMatrix elastic_matrix(const ElasticConstants& elastic);

}  // namespace knothe::offline
