#pragma once
/// @file Bilinear finite elements on a rectangle: the matrices of small linear problems, for examples and
/// tests.
#include <Eigen/SparseCore>
#include <functional>

namespace knothe::numerics {

/// [0, length] × [0, height] in columns × rows equal rectangles; nodes row by row, x fastest.
struct RectangleGrid {
  int columns = 1, rows = 1;
  double length = 1, height = 1;  ///< metres

  [[nodiscard]] Eigen::Index node_count() const { return Eigen::Index{columns + 1} * (rows + 1); }
  [[nodiscard]] Eigen::Index node(int column, int row) const {
    return Eigen::Index{row} * (columns + 1) + column;
  }
  [[nodiscard]] Eigen::Vector2d point(Eigen::Index node) const {
    return {length * static_cast<double>(node % (columns + 1)) / columns,
            height * static_cast<double>(node / (columns + 1)) / rows};
  }
};

/// Weight of an element by its centre (x, y); 0 leaves it out.
using ElementWeight = std::function<double(double x, double y)>;

/// ∫ w φ_i φ_j, 2 × 2 Gauss points. n × n with n the number of nodes. All of these: UsageError for a grid
/// without elements or of no size.
[[nodiscard]] Eigen::SparseMatrix<double> mass_matrix(const RectangleGrid& grid,
                                                      const ElementWeight& weight = {});
/// ∫ w ∇φ_i · ∇φ_j.
[[nodiscard]] Eigen::SparseMatrix<double> diffusion_matrix(const RectangleGrid& grid,
                                                           const ElementWeight& weight = {});
/// ∫ w ε(φ_i) : C ε(φ_j) in plane strain, Young's modulus (Pa) and Poisson's ratio; dof 2 node + component.
[[nodiscard]] Eigen::SparseMatrix<double> elasticity_matrix(const RectangleGrid& grid, double young_modulus,
                                                            double poisson_ratio,
                                                            const ElementWeight& weight = {});
/// ∫ f φ_i.
[[nodiscard]] Eigen::VectorXd load_vector(const RectangleGrid& grid,
                                          const std::function<double(double x, double y)>& f);

/// Rows and columns `kept` of a square matrix, in that order (homogeneous Dirichlet conditions on the
/// others).
[[nodiscard]] Eigen::SparseMatrix<double> restricted(const Eigen::SparseMatrix<double>& matrix,
                                                     const std::vector<Eigen::Index>& kept);

}  // namespace knothe::numerics
