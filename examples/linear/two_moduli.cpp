// Elasticity with two moduli: a cantilever in plane strain, its left half stiffer or softer than its right
// one.
//
// Run:  build/release/examples/example_two_moduli two_moduli.h5
//       knothe simulate examples/linear/two_moduli.toml -o two_moduli_data.h5; knothe assimilate
//       examples/linear/two_moduli.toml
//
// (E₁ K₁ + E₂ K₂) u = t f with the weight f put on in ten steps: affine in both moduli, so progressive
// Galerkin needs no snapshots.
//   1. stiffness of either half, and the load,   2. the separated problem over (x, t, E₁, E₂),   3. the
//   solution,
//   4. its error against direct solutions on and off the grid, and the model file, which the online phase
//   takes like any other.
#include <Eigen/SparseCholesky>
#include <array>
#include <cmath>
#include <cstdio>

#include "knothe/numerics/testing/rectangle_elements.hpp"
#include "knothe/reduction/compress/progressive_galerkin.hpp"
#include "knothe/reduction/model/separated_model.hpp"

using Eigen::Index, Eigen::VectorXd;
using SparseMatrix = Eigen::SparseMatrix<double>;

namespace {

SparseMatrix diagonal(const VectorXd& d) {
  SparseMatrix out(d.size(), d.size());
  for (Index i = 0; i < d.size(); ++i) out.insert(i, i) = d[i];
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace knothe;
  const std::string file = argc > 1 ? argv[1] : "two_moduli.h5";

  // 1. The cantilever, 2 m × 0.5 m, clamped at x = 0; E in GPa, weight 25 kN/m³.
  const numerics::RectangleGrid grid{40, 10, 2.0, 0.5};
  std::vector<Index> free;
  for (Index dof = 0; dof < 2 * grid.node_count(); ++dof)
    if (grid.point(dof / 2)[0] > 0) free.push_back(dof);
  const auto stiffness = [&](bool left_half) {
    const auto inside = [=](double x, double) { return (x < 1.0) == left_half ? 1.0 : 0.0; };
    return numerics::restricted(numerics::elasticity_matrix(grid, 1e9, 0.2, inside), free);
  };
  const SparseMatrix left = stiffness(true), right = stiffness(false);
  const VectorXd weight = numerics::load_vector(grid, [](double, double) { return -25e3; });
  VectorXd load = VectorXd::Zero(static_cast<Index>(free.size()));
  for (std::size_t i = 0; i < free.size(); ++i)
    if (free[i] % 2 == 1) load[static_cast<Index>(i)] = weight[free[i] / 2];

  // 2. Coordinates: x, t, E₁, E₂. A parameter's matrix is the diagonal of its values (collocation).
  const VectorXd time = VectorXd::LinSpaced(10, 0.1, 1.0), modulus = VectorXd::LinSpaced(9, 10, 50);
  const SparseMatrix any_time = diagonal(VectorXd::Ones(10)), any = diagonal(VectorXd::Ones(9));
  const VectorXd one = VectorXd::Ones(9);
  reduction::SeparatedProblem problem;
  problem.operators = {{left, any_time, diagonal(modulus), any}, {right, any_time, any, diagonal(modulus)}};
  problem.loads = {{load, time, one, one}};

  // 3. Term by term.
  const auto result = solve_progressive_galerkin(problem, {.tolerance = 1e-7, .max_modes = 40});
  for (std::size_t m = 0; m < result.history.size(); m += 4)
    std::printf("%2zu modes: residual %.1e, work and energy balance to %.0e\n", m + 1,
                result.history[m].residual, result.history[m].imbalance);

  // 4. Direct solutions: everywhere on the grid, and at one point off it.
  reduction::Dofs dofs;
  for (const Index dof : free) {
    const Eigen::Vector2d x = grid.point(dof / 2);
    dofs.points.insert(dofs.points.end(), {x[0], x[1], 0.0});
    dofs.components.push_back(dof % 2);
  }
  const std::vector<double> values(modulus.begin(), modulus.end());
  auto contents = canonical_model(result.solution, {time.begin(), time.end()},
                                  {{"E1", values, "GPa", "Young's modulus of the left half", 1.0},
                                   {"E2", values, "GPa", "Young's modulus of the right half", 1.0}},
                                  dofs);
  const reduction::SeparatedModel unsaved(contents);
  double largest = 0, square = 0, size = 0;
  const auto error = [&](double e1, double e2) {
    const SparseMatrix matrix = e1 * left + e2 * right;
    const VectorXd exact = Eigen::SimplicialLDLT<SparseMatrix>(matrix).solve(load);  // at t = 1
    const auto field = unsaved.evaluate(std::array{e1, e2}, 9);
    const VectorXd deviation = Eigen::Map<const VectorXd>(field.value.data(), exact.size()) - exact;
    largest = std::max(largest, exact.lpNorm<Eigen::Infinity>());
    square += deviation.squaredNorm(), size += exact.squaredNorm();
    return deviation.lpNorm<Eigen::Infinity>();
  };
  for (const double e1 : values)
    for (const double e2 : values) contents.max_error_m = std::max(contents.max_error_m, error(e1, e2));
  contents.relative_error = std::sqrt(square / size);
  const double off_grid = error(23, 37);
  reduction::SeparatedModel(contents).save(file);
  std::printf(
      "%s: differs from direct solutions by %.1e of the largest displacement on the grid, %.1e off it\n",
      file.c_str(), contents.max_error_m / largest, off_grid / largest);
  return contents.max_error_m < 1e-6 * largest && off_grid < 1e-3 * largest ? 0 : 1;
}
