#pragma once
/// @file Penalties on the displacement for where the pictures alone say too little. Private to the room.
#include <Eigen/SparseCore>
#include <vector>

#include "knothe/imaging/mesh/image_mesh.hpp"

namespace knothe::imaging {

/// R of uᵀRu = ∫ |∇u|² (Tikhonov): a wave of wave number k has k² per px². 2 per node; px⁰.
[[nodiscard]] Eigen::SparseMatrix<double> gradient_penalty(const ImageMesh& mesh);

/// R of uᵀRu = Σ_a |(K u)_a|² / A_a, K the stiffness of an elastic sheet (plane stress, shear modulus 1),
/// over the nodes inside, A_a their area: the forces that would be missing for equilibrium (equilibrium gap;
/// Roux and Hild). A shear wave has k⁴ per px², a pressure wave (2/(1 − ν))² times that, an elastic field
/// nothing. `carries`: elements that are 0 have no stiffness, so that a crack is not pulled together; nodes
/// at their edge and at the mesh's are not inside: forces act there.
[[nodiscard]] Eigen::SparseMatrix<double> equilibrium_gap_penalty(const ImageMesh& mesh,
                                                                  const std::vector<char>& carries,
                                                                  double poisson_ratio);

}  // namespace knothe::imaging
