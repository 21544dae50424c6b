/// @file PGD of linear parametrised problems against direct solutions at the nodes.
#include "knothe/reduction/compress/progressive_galerkin.hpp"

#include <gtest/gtest.h>

#include <Eigen/SparseCholesky>
#include <cmath>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/numerics/testing/rectangle_elements.hpp"
#include "knothe/reduction/model/separated_model.hpp"

namespace knothe::reduction {
namespace {

using numerics::RectangleGrid;
using SparseMatrix = Eigen::SparseMatrix<double>;

SparseMatrix diagonal(const Eigen::VectorXd& d) {
  SparseMatrix out(d.size(), d.size());
  for (Eigen::Index i = 0; i < d.size(); ++i) out.insert(i, i) = d[i];
  return out;
}

SparseMatrix identity(Eigen::Index n) {
  return diagonal(Eigen::VectorXd::Ones(n));
}

Eigen::VectorXd solve(const SparseMatrix& matrix, const Eigen::VectorXd& right) {
  return Eigen::SimplicialLDLT<SparseMatrix>(matrix).solve(right);
}

/// A cantilever of two materials in plane strain, loaded by its weight; the moduli of both halves vary.
struct TwoModuli {
  RectangleGrid grid{12, 6, 0.2, 0.1};
  Eigen::VectorXd left = Eigen::VectorXd::LinSpaced(7, 0.5, 2), right = Eigen::VectorXd::LinSpaced(6, 0.4, 3);
  SparseMatrix stiffness_left, stiffness_right;
  Eigen::VectorXd load;
  SeparatedProblem problem;

  TwoModuli() {
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = 0; i < 2 * grid.node_count(); ++i)
      if (grid.point(i / 2)[0] > 0) free.push_back(i);
    const auto half = [&](bool is_left) {
      return numerics::restricted(
          numerics::elasticity_matrix(grid, 1e3, 0.3,
                                      [=](double x, double) { return (x < 0.1) == is_left ? 1.0 : 0.0; }),
          free);
    };
    stiffness_left = half(true), stiffness_right = half(false);
    const Eigen::VectorXd weight = numerics::load_vector(grid, [](double, double) { return -25.0; });
    load.resize(static_cast<Eigen::Index>(free.size()));
    for (std::size_t i = 0; i < free.size(); ++i)
      load[static_cast<Eigen::Index>(i)] = free[i] % 2 == 1 ? weight[free[i] / 2] : 0.0;
    problem.operators = {{stiffness_left, diagonal(left), identity(right.size())},
                         {stiffness_right, identity(left.size()), diagonal(right)}};
    problem.loads = {{load, Eigen::VectorXd::Ones(left.size()), Eigen::VectorXd::Ones(right.size())}};
  }

  /// Largest error over all parameter points, relative to the largest solution.
  [[nodiscard]] double error(const SeparatedTensor& u) const {
    double worst = 0, largest = 0;
    for (Eigen::Index i = 0; i < left.size(); ++i)
      for (Eigen::Index j = 0; j < right.size(); ++j) {
        const Eigen::VectorXd exact = solve(left[i] * stiffness_left + right[j] * stiffness_right, load);
        const Eigen::VectorXd found =
            u.factors()[0] *
            (u.factors()[1].row(i).transpose().cwiseProduct(u.factors()[2].row(j).transpose()));
        worst = std::max(worst, (found - exact).lpNorm<Eigen::Infinity>());
        largest = std::max(largest, exact.lpNorm<Eigen::Infinity>());
      }
    return worst / largest;
  }
};

TEST(ProgressiveGalerkin, TwoModuliAgainstDirectSolutions) {
  const TwoModuli cantilever;
  double before = 1;
  for (const int modes : {1, 2, 4, 8}) {
    const auto result =
        solve_progressive_galerkin(cantilever.problem, {.tolerance = 1e-12, .max_modes = modes});
    const double error = cantilever.error(result.solution);
    EXPECT_LT(error, before) << modes;
    before = error;
  }
  const auto result = solve_progressive_galerkin(cantilever.problem, {.tolerance = 1e-6, .max_modes = 30});
  EXPECT_TRUE(result.converged) << result.reason;
  EXPECT_LT(cantilever.error(result.solution), 1e-6);
}

TEST(ProgressiveGalerkin, EachTermLowersTheEnergyAndWorkBalances) {
  const TwoModuli cantilever;
  const auto result = solve_progressive_galerkin(cantilever.problem, {.tolerance = 1e-7, .max_modes = 25});
  // The exact minimum: −½ Σ fᵀ K⁻¹ f over the points.
  double exact = 0;
  for (const double a : cantilever.left)
    for (const double b : cantilever.right)
      exact -= 0.5 * cantilever.load.dot(solve(a * cantilever.stiffness_left + b * cantilever.stiffness_right,
                                               cantilever.load));
  double before = 0;
  for (const EnrichmentRecord& record : result.history) {
    EXPECT_LT(record.energy, before + 1e-12 * std::abs(exact));
    EXPECT_LT(record.imbalance, 1e-9);
    before = record.energy;
  }
  EXPECT_GE(before, exact - 1e-10 * std::abs(exact));
  EXPECT_NEAR(before, exact, 1e-9 * std::abs(exact));
}

/// Heat in a plate under a source that moves along its lower edge (a weld): ρc Ṫ − κ ΔT = q(x − v t), the
/// upper edge at the reference temperature; conductivity and flux vary; backward Euler in time.
struct Weld {
  RectangleGrid grid{16, 8, 1.0, 0.5};
  int steps = 20;
  double dt = 0.05;
  Eigen::VectorXd conductivity = Eigen::VectorXd::LinSpaced(5, 0.05, 0.2),
                  flux = Eigen::VectorXd::LinSpaced(3, 0.5, 1.5);
  SparseMatrix mass, diffusion;
  Eigen::MatrixXd load;  ///< node × step
  std::vector<Eigen::Index> free;
  SeparatedProblem problem;

  Weld() {
    for (Eigen::Index i = 0; i < grid.node_count(); ++i)
      if (grid.point(i)[1] < 0.5 - 1e-9) free.push_back(i);
    mass = numerics::restricted(numerics::mass_matrix(grid), free);
    diffusion = numerics::restricted(numerics::diffusion_matrix(grid), free);
    load.resize(static_cast<Eigen::Index>(free.size()), steps);
    SparseMatrix difference(steps, steps);
    for (int k = 0; k < steps; ++k) {
      difference.insert(k, k) = 1 / dt;
      if (k > 0) difference.insert(k, k - 1) = -1 / dt;
      const double at = 0.2 + 0.6 * (k + 1) * dt;
      const Eigen::VectorXd all = numerics::load_vector(
          grid, [=](double x, double y) { return std::exp(-((x - at) * (x - at) + y * y) / 0.02); });
      for (std::size_t i = 0; i < free.size(); ++i) load(static_cast<Eigen::Index>(i), k) = all[free[i]];
    }
    const auto ones = [](Eigen::Index n) { return Eigen::VectorXd(Eigen::VectorXd::Ones(n)); };
    problem.operators = {{mass, difference, identity(conductivity.size()), identity(flux.size())},
                         {diffusion, identity(steps), diagonal(conductivity), identity(flux.size())}};
    for (int k = 0; k < steps; ++k)
      problem.loads.push_back(
          {load.col(k), Eigen::VectorXd::Unit(steps, k), ones(conductivity.size()), flux});
  }

  /// Temperature at all steps by marching in time.
  [[nodiscard]] Eigen::MatrixXd march(double kappa, double q) const {
    Eigen::MatrixXd out(mass.rows(), steps);
    const SparseMatrix matrix = mass / dt + kappa * diffusion;
    const Eigen::SimplicialLDLT<SparseMatrix> factor(matrix);
    Eigen::VectorXd now = Eigen::VectorXd::Zero(mass.rows());
    for (int k = 0; k < steps; ++k) out.col(k) = now = factor.solve(mass * now / dt + q * load.col(k));
    return out;
  }
};

/// Largest error against marching in time, relative to the largest temperature. `w`: row of a parameter point
/// and time → weights of the space modes.
double error_of(const Weld& weld, const Eigen::MatrixXd& space,
                const std::function<Eigen::VectorXd(Eigen::Index, Eigen::Index, Eigen::Index)>& w) {
  double worst = 0, largest = 0;
  for (Eigen::Index i = 0; i < weld.conductivity.size(); ++i)
    for (Eigen::Index j = 0; j < weld.flux.size(); ++j) {
      const Eigen::MatrixXd exact = weld.march(weld.conductivity[i], weld.flux[j]);
      for (Eigen::Index k = 0; k < weld.steps; ++k)
        worst = std::max(worst, (space * w(k, i, j) - exact.col(k)).lpNorm<Eigen::Infinity>());
      largest = std::max(largest, exact.lpNorm<Eigen::Infinity>());
    }
  return worst / largest;
}

TEST(ProgressiveGalerkin, MovingHeatSourceAgainstTimeMarching) {
  const Weld weld;
  double before = 1;
  for (const int modes : {5, 15, 40}) {
    const auto result = solve_progressive_galerkin(weld.problem, {.tolerance = 1e-9, .max_modes = modes});
    const auto& f = result.solution.factors();
    const double error = error_of(weld, f[0], [&](Eigen::Index k, Eigen::Index i, Eigen::Index j) {
      return Eigen::VectorXd(f[1].row(k).cwiseProduct(f[2].row(i)).cwiseProduct(f[3].row(j)).transpose());
    });
    EXPECT_LT(error, 0.5 * before) << modes;
    EXPECT_FALSE(result.converged);
    before = error;
  }
  EXPECT_LT(before, 1e-3);  // a travelling source is what full separation is worst at
}

TEST(ProgressiveGalerkin, TimeAndConductivityTogetherSeparateWell) {
  Weld weld;
  const Eigen::Index n_k = weld.conductivity.size(), n = weld.steps * n_k;
  SparseMatrix difference(n, n);
  Eigen::VectorXd kappa(n);
  for (Eigen::Index k = 0; k < weld.steps; ++k)
    for (Eigen::Index i = 0; i < n_k; ++i) {
      difference.insert(k * n_k + i, k * n_k + i) = 1 / weld.dt;
      if (k > 0) difference.insert(k * n_k + i, (k - 1) * n_k + i) = -1 / weld.dt;
      kappa[k * n_k + i] = weld.conductivity[i];
    }
  const Eigen::Index n_q = weld.flux.size();
  SeparatedProblem joint;
  joint.operators = {{weld.mass, difference, identity(n_q)},
                     {weld.diffusion, diagonal(kappa), identity(n_q)}};
  for (Eigen::Index k = 0; k < weld.steps; ++k) {
    Eigen::VectorXd at = Eigen::VectorXd::Zero(n);
    at.segment(k * n_k, n_k).setOnes();
    joint.loads.push_back({weld.load.col(k), at, weld.flux});
  }
  const auto result = solve_progressive_galerkin(joint, {.tolerance = 1e-6, .max_modes = 60});
  EXPECT_TRUE(result.converged) << result.reason;
  const auto& f = result.solution.factors();
  const double error = error_of(weld, f[0], [&](Eigen::Index k, Eigen::Index i, Eigen::Index j) {
    return Eigen::VectorXd(f[1].row(k * n_k + i).cwiseProduct(f[2].row(j)).transpose());
  });
  EXPECT_LT(error, 1e-6);
}

TEST(ProgressiveGalerkin, TheModelGivesTheSolutionAtTheNodes) {
  const Weld weld;
  const auto result = solve_progressive_galerkin(weld.problem, {.tolerance = 1e-3, .max_modes = 12});
  Dofs dofs;
  for (const Eigen::Index node : weld.free) {
    const Eigen::Vector2d x = weld.grid.point(node);
    dofs.points.insert(dofs.points.end(), {x[0], x[1], 0.0});
    dofs.components.push_back(0);
  }
  const auto nodes = [](const Eigen::VectorXd& v) { return std::vector<double>(v.begin(), v.end()); };
  std::vector<double> time(static_cast<std::size_t>(weld.steps));
  std::iota(time.begin(), time.end(), 1.0);
  const std::vector<Axis> axes = {{"kappa", nodes(weld.conductivity), "W/(m K)", "conductivity", 1.0},
                                  {"q", nodes(weld.flux), "W/m2", "flux", 1.0}};
  const SeparatedModel model(canonical_model(result.solution, time, axes, dofs));
  const std::vector<double> p = {weld.conductivity[3], weld.flux[1]};
  const FieldDerivatives field = model.evaluate(p, 7);
  for (std::size_t i = 0; i < field.count; ++i)
    EXPECT_NEAR(field.value[i], result.solution.at({static_cast<Eigen::Index>(i), 7, 3, 1}), 1e-12);
  EXPECT_THROW((void)canonical_model(result.solution, {1.0}, axes, dofs), UsageError);
}

TEST(ProgressiveGalerkin, MistakesAreExplained) {
  const auto message = [](const SeparatedProblem& problem) {
    try {
      (void)solve_progressive_galerkin(problem);
    } catch (const std::exception& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  TwoModuli cantilever;
  SeparatedProblem none;
  EXPECT_EQ(message(none), "separated problem: at least one operator term and one load term are needed");
  SeparatedProblem small = cantilever.problem;
  small.operators[1][1] = identity(3);
  EXPECT_EQ(message(small),
            "separated problem: operator term 1, coordinate 1: 7 × 7, and finite entries, are needed");
  SeparatedProblem loose;  // no boundary condition: rigid motions are free
  loose.operators = {{SparseMatrix(2, 2), identity(2)}};
  loose.loads = {{Eigen::VectorXd::Ones(2), Eigen::VectorXd::Ones(2)}};
  EXPECT_NE(message(loose).find("the operator of coordinate 0 is singular; are there boundary conditions?"),
            std::string::npos);
  const auto interrupted = [&] {
    ProgressiveGalerkinOptions options;
    options.progress = [](int modes, double) { return modes < 2; };
    (void)solve_progressive_galerkin(cantilever.problem, options);
  };
  EXPECT_THROW(interrupted(), Interrupted);
}

}  // namespace
}  // namespace knothe::reduction
