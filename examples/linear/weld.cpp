// A weld: heat in a plate under a source that travels along its lower edge, over (x, t, conductivity, flux).
//
// Run:  build/release/examples/example_weld weld.h5
//       knothe simulate examples/linear/weld.toml -o weld_data.h5; knothe assimilate
//       examples/linear/weld.toml
//
// ρc ∂T/∂t − κ ΔT = 0 in 1 m × 0.5 m, flux q exp(−(x − v t)²/2s²) through the lower edge, T = 0 on the upper
// one; backward Euler. The operator is affine in κ, the load in q: progressive Galerkin needs no snapshots.
//   1. matrices of the plate,   2. the separated problem,   3. the solution, and its error against marching
//   in time at a point of the parameter box,   4. the model file, which the online phase takes like any
//   other.
#include <Eigen/SparseCholesky>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "knothe/numerics/testing/rectangle_elements.hpp"
#include "knothe/reduction/compress/progressive_galerkin.hpp"
#include "knothe/reduction/model/separated_model.hpp"

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using SparseMatrix = Eigen::SparseMatrix<double>;

namespace {

constexpr int k_steps = 30;
constexpr double k_dt = 1.0 / k_steps, k_speed = 0.6;

SparseMatrix diagonal(const VectorXd& d) {
  SparseMatrix out(d.size(), d.size());
  for (Index i = 0; i < d.size(); ++i) out.insert(i, i) = d[i];
  return out;
}

std::vector<double> to_vector(const VectorXd& v) {
  return {v.begin(), v.end()};
}

}  // namespace

int main(int argc, char** argv) {
  using namespace knothe;
  const std::string file = argc > 1 ? argv[1] : "weld.h5";

  // 1. The plate. Nodes on the upper edge have no unknown.
  const numerics::RectangleGrid grid{40, 20, 1.0, 0.5};
  std::vector<Index> free;
  for (Index i = 0; i < grid.node_count(); ++i)
    if (grid.point(i)[1] < grid.height * (1 - 1e-9)) free.push_back(i);
  const auto n = static_cast<Index>(free.size());
  const SparseMatrix mass = numerics::restricted(numerics::mass_matrix(grid), free),
                     diffusion = numerics::restricted(numerics::diffusion_matrix(grid), free);
  MatrixXd load = MatrixXd::Zero(n, k_steps);  // the source at every step, lumped on the lower edge
  for (Index i = 0; i < n; ++i)
    if (const Eigen::Vector2d x = grid.point(free[static_cast<std::size_t>(i)]); x[1] == 0)
      for (int k = 0; k < k_steps; ++k) {
        const double distance = x[0] - 0.2 - k_speed * (k + 1) * k_dt;
        load(i, k) = grid.length / grid.columns * std::exp(-0.5 * distance * distance / (0.12 * 0.12));
      }

  // 2. (M ⊗ D + κ K ⊗ 1) T = q Σ_k f_k ⊗ e_k.
  const VectorXd kappa = VectorXd::LinSpaced(9, 0.05, 0.2), flux = VectorXd::LinSpaced(3, 0.5, 1.5);
  SparseMatrix difference(k_steps, k_steps);
  for (int k = 0; k < k_steps; ++k) {
    difference.insert(k, k) = 1 / k_dt;
    if (k > 0) difference.insert(k, k - 1) = -1 / k_dt;
  }
  const VectorXd one_t = VectorXd::Ones(k_steps), one_k = VectorXd::Ones(9), one_q = VectorXd::Ones(3);
  reduction::SeparatedProblem problem;
  problem.operators = {{mass, difference, diagonal(one_k), diagonal(one_q)},
                       {diffusion, diagonal(one_t), diagonal(kappa), diagonal(one_q)}};
  for (int k = 0; k < k_steps; ++k)
    problem.loads.push_back({load.col(k), VectorXd::Unit(k_steps, k), one_k, flux});

  // 3. Term by term.
  const auto result = solve_progressive_galerkin(problem, {.tolerance = 1e-4, .max_modes = 60});
  for (std::size_t m = 9; m < result.history.size(); m += 10)
    std::printf("%2zu modes: residual %.1e\n", m + 1, result.history[m].residual);

  // 4. To the file, with its error against marching in time over the whole grid, and off it.
  reduction::Dofs dofs;
  for (const Index node : free) {
    const Eigen::Vector2d x = grid.point(node);
    dofs.points.insert(dofs.points.end(), {x[0], x[1], 0.0});
    dofs.components.push_back(0);
  }
  std::vector<double> time(k_steps);
  std::iota(time.begin(), time.end(), 1.0);
  for (double& t : time) t *= k_dt;
  auto contents = canonical_model(result.solution, time,
                                  {{"kappa", to_vector(kappa), "W/(m K)", "conductivity", 1.0},
                                   {"q", to_vector(flux), "W/m2", "heat flux", 1.0}},
                                  dofs);
  contents.field = {"K", "temperature"};
  struct Error {
    double difference = 0, size = 0, worst = 0, largest = 0;
  };
  const auto add_error = [&](const reduction::SeparatedModel& model, double k, double q, Error& error) {
    const SparseMatrix matrix = mass / k_dt + k * diffusion;
    const Eigen::SimplicialLDLT<SparseMatrix> factor(matrix);
    VectorXd temperature = VectorXd::Zero(n);
    for (int step = 0; step < k_steps; ++step) {
      temperature = factor.solve(mass * temperature / k_dt + q * load.col(step));
      const auto field = model.evaluate(std::array{k, q}, static_cast<std::size_t>(step));
      const VectorXd deviation = Eigen::Map<const VectorXd>(field.value.data(), n) - temperature;
      error.difference += deviation.squaredNorm(), error.size += temperature.squaredNorm();
      error.worst = std::max(error.worst, deviation.lpNorm<Eigen::Infinity>());
      error.largest = std::max(error.largest, temperature.lpNorm<Eigen::Infinity>());
    }
  };
  Error on_grid, off_grid;
  for (const double k : kappa)
    for (const double q : flux) add_error(reduction::SeparatedModel(contents), k, q, on_grid);
  contents.relative_error = std::sqrt(on_grid.difference / on_grid.size);
  contents.max_error_m = on_grid.worst;
  const reduction::SeparatedModel model(contents);
  model.save(file);
  add_error(model, 0.11, 1.2, off_grid);
  std::printf("%s: differs from time marching by %.1e of the largest temperature on the grid, %.1e off it\n",
              file.c_str(), on_grid.worst / on_grid.largest, off_grid.worst / off_grid.largest);
  return off_grid.worst < 1e-3 * off_grid.largest ? 0 : 1;
}
