#include "knothe/numerics/testing/rectangle_elements.hpp"

#include <array>
#include <cmath>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::numerics {

namespace {

using Triplets = std::vector<Eigen::Triplet<double>>;

/// Values and gradients of the four bilinear functions at the four Gauss points of an element of size a × b.
struct ElementTables {
  Eigen::Matrix4d value;                                ///< point × function
  std::array<Eigen::Matrix<double, 4, 2>, 4> gradient;  ///< one per point: function × direction
  double weight;                                        ///< of each point

  ElementTables(double a, double b) : weight(0.25 * a * b) {
    const double g = 0.5 / std::sqrt(3.0), at[2] = {0.5 - g, 0.5 + g};
    for (int p = 0; p < 4; ++p) {
      const double x = at[p % 2], y = at[p / 2];
      const double fx[2] = {1 - x, x}, fy[2] = {1 - y, y}, dx[2] = {-1 / a, 1 / a}, dy[2] = {-1 / b, 1 / b};
      for (int i = 0; i < 4; ++i) {
        value(p, i) = fx[i % 2] * fy[i / 2];
        gradient[static_cast<std::size_t>(p)].row(i) << dx[i % 2] * fy[i / 2], fx[i % 2] * dy[i / 2];
      }
    }
  }
};

void require(const RectangleGrid& g) {
  if (g.columns < 1 || g.rows < 1 || !(g.length > 0) || !(g.height > 0) ||
      !std::isfinite(g.length * g.height))
    throw UsageError("rectangle grid: at least one element in each direction and a positive size are needed");
}

/// Calls `body(nodes, weight, centre)` for every element that counts.
template <class Body>
void for_elements(const RectangleGrid& g, const ElementWeight& weight, const Body& body) {
  const double a = g.length / g.columns, b = g.height / g.rows;
  for (int row = 0; row < g.rows; ++row)
    for (int column = 0; column < g.columns; ++column) {
      const Eigen::Vector2d corner(column * a, row * b);
      const double w = weight ? weight(corner[0] + 0.5 * a, corner[1] + 0.5 * b) : 1.0;
      if (w == 0) continue;
      body(std::array{g.node(column, row), g.node(column + 1, row), g.node(column, row + 1),
                      g.node(column + 1, row + 1)},
           w, corner);
    }
}

/// Adds the same element matrix, scaled, at all elements. `fields` dofs per node.
Eigen::SparseMatrix<double> assemble(const RectangleGrid& g, const ElementWeight& weight, int fields,
                                     const Eigen::MatrixXd& element) {
  Triplets entries;
  const auto dof = [&](const auto& nodes, Eigen::Index i) {
    return static_cast<int>(fields * nodes[static_cast<std::size_t>(i / fields)] + i % fields);
  };
  for_elements(g, weight, [&](const auto& nodes, double w, const Eigen::Vector2d&) {
    for (Eigen::Index i = 0; i < element.rows(); ++i)
      for (Eigen::Index j = 0; j < element.cols(); ++j)
        if (element(i, j) != 0) entries.emplace_back(dof(nodes, i), dof(nodes, j), w * element(i, j));
  });
  Eigen::SparseMatrix<double> matrix(fields * g.node_count(), fields * g.node_count());
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

}  // namespace

Eigen::SparseMatrix<double> mass_matrix(const RectangleGrid& grid, const ElementWeight& weight) {
  require(grid);
  const ElementTables t(grid.length / grid.columns, grid.height / grid.rows);
  return assemble(grid, weight, 1, t.weight * t.value.transpose() * t.value);
}

Eigen::SparseMatrix<double> diffusion_matrix(const RectangleGrid& grid, const ElementWeight& weight) {
  require(grid);
  const ElementTables t(grid.length / grid.columns, grid.height / grid.rows);
  Eigen::Matrix4d element = Eigen::Matrix4d::Zero();
  for (const auto& gradient : t.gradient) element += t.weight * gradient * gradient.transpose();
  return assemble(grid, weight, 1, element);
}

Eigen::SparseMatrix<double> elasticity_matrix(const RectangleGrid& grid, double young_modulus,
                                              double poisson_ratio, const ElementWeight& weight) {
  require(grid);
  if (!(young_modulus > 0) || !(poisson_ratio > -1) || !(poisson_ratio < 0.5))
    throw UsageError("elasticity: Young's modulus must be positive, Poisson's ratio between -1 and 0.5");
  const double lambda = young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio)),
               mu = young_modulus / (2 * (1 + poisson_ratio));
  Eigen::Matrix3d c;
  c << lambda + 2 * mu, lambda, 0, lambda, lambda + 2 * mu, 0, 0, 0, mu;
  const ElementTables t(grid.length / grid.columns, grid.height / grid.rows);
  Eigen::MatrixXd element = Eigen::MatrixXd::Zero(8, 8);
  for (const auto& gradient : t.gradient) {
    Eigen::Matrix<double, 3, 8> strain = Eigen::Matrix<double, 3, 8>::Zero();
    for (int i = 0; i < 4; ++i) {
      strain(0, 2 * i) = strain(2, 2 * i + 1) = gradient(i, 0);
      strain(1, 2 * i + 1) = strain(2, 2 * i) = gradient(i, 1);
    }
    element += t.weight * strain.transpose() * c * strain;
  }
  return assemble(grid, weight, 2, element);
}

Eigen::VectorXd load_vector(const RectangleGrid& grid, const std::function<double(double, double)>& f) {
  require(grid);
  const double a = grid.length / grid.columns, b = grid.height / grid.rows;
  const ElementTables t(a, b);
  const double g = 0.5 / std::sqrt(3.0), at[2] = {0.5 - g, 0.5 + g};
  Eigen::VectorXd load = Eigen::VectorXd::Zero(grid.node_count());
  for_elements(grid, {}, [&](const auto& nodes, double, const Eigen::Vector2d& corner) {
    for (int p = 0; p < 4; ++p) {
      const double value = t.weight * f(corner[0] + a * at[p % 2], corner[1] + b * at[p / 2]);
      for (int i = 0; i < 4; ++i) load[nodes[static_cast<std::size_t>(i)]] += value * t.value(p, i);
    }
  });
  return load;
}

Eigen::SparseMatrix<double> restricted(const Eigen::SparseMatrix<double>& matrix,
                                       const std::vector<Eigen::Index>& kept) {
  std::vector<int> position(static_cast<std::size_t>(matrix.rows()), -1);
  for (std::size_t i = 0; i < kept.size(); ++i)
    position[static_cast<std::size_t>(kept[i])] = static_cast<int>(i);
  Triplets entries;
  for (int k = 0; k < matrix.outerSize(); ++k)
    for (Eigen::SparseMatrix<double>::InnerIterator it(matrix, k); it; ++it) {
      const int row = position[static_cast<std::size_t>(it.row())],
                column = position[static_cast<std::size_t>(it.col())];
      if (row >= 0 && column >= 0) entries.emplace_back(row, column, it.value());
    }
  const auto n = static_cast<Eigen::Index>(kept.size());
  Eigen::SparseMatrix<double> out(n, n);
  out.setFromTriplets(entries.begin(), entries.end());
  return out;
}

}  // namespace knothe::numerics
