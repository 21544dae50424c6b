#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::posterior {
namespace {

using targets::Planar;

/// A narrow ridge y ≈ 0.4 x + 0.1 x² with three bumps along it: evidence 1.
void bumpy_ridge(double x, double y, double* r) {
  constexpr double weight[3] = {0.3, 0.4, 0.3}, at[3] = {-1.5, 0.1, 1.4}, spread[3] = {0.55, 0.4, 0.6},
                   s = 0.1;
  double p = 0, p1 = 0, p2 = 0;
  for (int k = 0; k < 3; ++k) {
    const double u = (x - at[k]) / spread[k],
                 q = weight[k] * std::exp(-0.5 * u * u) / (spread[k] * std::sqrt(2 * std::numbers::pi));
    p += q, p1 -= q * u / spread[k], p2 += q * (u * u - 1) / (spread[k] * spread[k]);
  }
  const double c = 0.4 * x + 0.1 * x * x, c1 = 0.4 + 0.2 * x, u = (y - c) / s;
  r[0] = std::log(p) - 0.5 * u * u - std::log(s * std::sqrt(2 * std::numbers::pi));
  r[1] = p1 / p + u * c1 / s;
  r[2] = -u / s;
  r[3] = p2 / p - p1 * p1 / (p * p) - c1 * c1 / (s * s) + u * 0.2 / s;
  r[4] = c1 / (s * s);
  r[5] = -1 / (s * s);
}

TEST(MapSolver, ALongFirstVariableFollowsBumpsAlongARidge) {
  Planar target(bumpy_ridge);
  MapSolverOptions options;
  options.search_modes = ModeSearchLevel::none;
  options.fallback = false;
  options.tolerance = 5e-3;
  options.long_first_variable = false;
  const MapResult orders = MapSolver(options).solve(target);
  EXPECT_FALSE(orders.tolerance_reached);
  options.long_first_variable = true;
  MapSolver solver(options);
  solver.prepare(2);
  const MapResult result = solver.solve(target);
  EXPECT_GT(result.order, options.max_order);
  EXPECT_LT(result.verified_diagnostic, 0.25 * orders.verified_diagnostic);
  EXPECT_NE(result.method.find("in the first variable"), std::string::npos) << result.method;
  // On points that neither training nor verification has seen.
  const Eigen::MatrixXd fresh = numerics::sobol_normal_points(4096, 2, 987);
  const ComposedMap map = result.composed();
  MapBatch at;
  map.evaluate(fresh, 0, at);
  LogDensityBatch density;
  density.resize(fresh.rows(), 2, 0);
  target.evaluate(at.value, 0, density);
  const Eigen::VectorXd log_weight = density.value + at.log_determinant - standard_normal_log_density(fresh);
  const double mean = log_weight.mean();
  EXPECT_NEAR(0.5 * (log_weight.array() - mean).square().mean(), result.verified_diagnostic,
              0.3 * result.verified_diagnostic + 1e-3);
  EXPECT_NEAR(solver.correct(target, result).log_evidence, 0, 5e-3);
}

}  // namespace
}  // namespace knothe::posterior
