#pragma once
/// @file What the solver needs of the finite elements: shape-function gradients and quadrature weights
/// (deal.II).
#include <cstdint>
#include <span>
#include <vector>

namespace knothe::offline {

constexpr int k_nodes_per_cell = 8;
constexpr int k_points_per_cell = 8;  ///< 2 × 2 × 2 Gauss points

/// Trilinear hexahedra with 2 × 2 × 2 Gauss points, as contiguous arrays.
struct FiniteElements {
  /// [cell][point][component][node]: ∂N_node/∂x_component, 1/m; nodes in the mesh's (VTK's) order.
  std::vector<double> gradients;
  /// [cell][point][node]: N_node, for fields other than the displacement.
  std::vector<double> values;
  /// [cell][point]: quadrature weight times Jacobian determinant, m³.
  std::vector<double> weights;

  [[nodiscard]] const double* gradient(std::int64_t cell, int point) const {
    return &gradients[(cell * k_points_per_cell + point) * 24];
  }
  [[nodiscard]] const double* value(std::int64_t cell, int point) const {
    return &values[(cell * k_points_per_cell + point) * k_nodes_per_cell];
  }
  [[nodiscard]] double weight(std::int64_t cell, int point) const {
    return weights[cell * k_points_per_cell + point];
  }
};

/// Evaluates deal.II's FE_Q(1) on the mesh of `points` (n × 3) and `cells` (c × 8, VTK's order, valid: see
/// validate(HexahedronMesh)). Throws DataError where deal.II refuses the mesh.
[[nodiscard]] FiniteElements evaluate_finite_elements(std::span<const double> points,
                                                      std::span<const std::int64_t> cells);

}  // namespace knothe::offline
