#pragma once
/// @file Strains at the nodes of a measured displacement field.
#include <Eigen/Core>
#include <vector>

#include "knothe/imaging/mesh/image_mesh.hpp"

namespace knothe::imaging {

/// Gradients du/dx, du/dy, dv/dx, dv/dy at the nodes (n_nodes × 4): the mean of those of the valid elements
/// around, taken at the node and weighted by their areas. Zero at nodes without a valid element.
[[nodiscard]] Eigen::MatrixXd nodal_gradients(const ImageMesh& mesh, const Eigen::VectorXd& displacement,
                                              const std::vector<char>& element_valid);

/// Small strains (n_nodes × 3: ε_xx, ε_yy, ε_xy; x to the right, y down, which changes the sign of none but
/// ε_xy) from nodal displacements (px), by `nodal_gradients`. With noise of standard deviation σ_u in the
/// displacements those of strains are about σ_u/h for elements of h px.
[[nodiscard]] Eigen::MatrixXd nodal_strains(const ImageMesh& mesh, const Eigen::VectorXd& displacement,
                                            const std::vector<char>& element_valid);

}  // namespace knothe::imaging
