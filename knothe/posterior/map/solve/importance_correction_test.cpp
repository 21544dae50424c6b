#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::posterior {
namespace {

using targets::Planar;
using targets::Ridge;

struct Case {
  const char* name;
  Planar::Function function;
  double half_width = 9;
};

/// The promise to the caller, against dense quadrature: mean within 0.02 std, std within 2 %, log-evidence
/// within 0.02, outer quantiles within 0.1 std, on narrow curved ridges against a box, with correlations up
/// to 0.997.
TEST(ImportanceCorrection, AgreesWithDenseQuadratureOnHardTargets) {
  const std::vector<Case> cases = {
      {"banana", targets::banana(0.7), 40},
      {"ridge", Ridge{}},
      {"ridge, narrow", Ridge{1, 1, 0.01, 1.0, 0.3}},
      {"ridge against the box", Ridge{1, 1.05, 0.01, 1.35, 0.15}},
      {"ridge against the lower corner", Ridge{1, 0.75, 0.01, 1.4, 0.3}},
      {"ridge, bent", Ridge{2, 1.3, 0.02, 1.2, 0.3}},
      {"ridge, more bent", Ridge{3, 1, 0.02, 1.0, 0.4}},
      {"ridge in the upper corner", Ridge{1, 1.9, 0.03, 1.4, 0.3}},
      {"truth outside the box", Ridge{1, 1.0, 0.02, 1.8, 0.2}},
      {"positive correlation", Ridge{-1, 1, 0.01, 0.6, 0.3}},
      {"very narrow", Ridge{1, 1, 0.003, 1.0, 0.3}},
      {"hardly informative", Ridge{1, 1, 0.3, 1.0, 1.0}},
  };
  MapSolver solver;
  for (const auto& c : cases) {
    Planar target(c.function);
    const MapResult result = solver.solve(target);
    const auto corrected = solver.correct(target, result);
    const auto reference = targets::dense_quadrature(
        c.function, {numerics::k_quantile_levels.begin(), numerics::k_quantile_levels.end()}, c.half_width);
    EXPECT_NEAR(corrected.log_evidence, reference.log_evidence, 0.02) << c.name;
    for (Eigen::Index a = 0; a < 2; ++a) {
      const double std = reference.standard_deviation[a];
      EXPECT_NEAR(corrected.mean[a], reference.mean[a], 0.02 * std) << c.name;
      EXPECT_NEAR(std::sqrt(corrected.covariance(a, a)) / std, 1, 0.02) << c.name;
      for (Eigen::Index l : {0, 4})
        EXPECT_NEAR(corrected.quantiles(a, l), reference.quantiles(a, l), 0.1 * std) << c.name;
    }
    const double correlation =
        corrected.covariance(0, 1) / std::sqrt(corrected.covariance(0, 0) * corrected.covariance(1, 1));
    EXPECT_NEAR(correlation, reference.correlation, 0.02) << c.name;
    EXPECT_TRUE(corrected.trust.trusted)
        << c.name << " " << corrected.ess << " " << result.verified_diagnostic;
    EXPECT_FALSE(result.second_mode_found) << c.name;
    // The map's own evidence is a lower bound, up to the error of the points.
    EXPECT_LT(corrected.map_log_evidence, reference.log_evidence + 0.01) << c.name;
  }
}

TEST(ImportanceCorrection, TakesMorePointsWhereWeightsAreUneven) {
  MapSolverOptions options;
  options.max_order = 1;  // an affine map for a banana: poor on purpose
  MapSolver solver(options);
  Planar target(targets::banana(0.5));
  const MapResult result = solver.solve(target);
  const auto corrected = solver.correct(target, result);
  EXPECT_GT(corrected.points.rows(), 1024);
  EXPECT_GT(corrected.density_evaluations, 0);
  EXPECT_FALSE(result.tolerance_reached);
  EXPECT_NE(result.reason.find("order 1 is the highest allowed"), std::string::npos);
  EXPECT_FALSE(corrected.trust.trusted);
  EXPECT_NEAR(corrected.weights.sum(), 1, 1e-12);
  EXPECT_NEAR(corrected.log_evidence, 0, 0.1);
  EXPECT_LT(corrected.map_log_evidence, -0.02);
}

TEST(ImportanceCorrection, HigherDimensions) {
  // A chain of bananas in five dimensions: x_1 ~ N(0,1), x_k ~ N(x_{k−1}²/4, 1/4); evidence 1, E x_2 = 1/4.
  struct Chain : LogDensity {
    Eigen::Index dimension() const override { return 5; }
    void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
      for (Eigen::Index i = 0; i < z.rows(); ++i) {
        double value = -0.5 * z(i, 0) * z(i, 0) - 2.5 * std::log(2 * std::numbers::pi) - 4 * std::log(0.5);
        if (order >= 1) out.gradient.row(i).setZero(), out.gradient(i, 0) = -z(i, 0);
        if (order >= 2) out.hessian.row(i).setZero(), out.hessian(i, 0) = -1;
        for (Eigen::Index k = 1; k < 5; ++k) {
          const double x = z(i, k - 1), u = z(i, k) - 0.25 * x * x;
          value -= 2 * u * u;
          if (order >= 1) out.gradient(i, k) -= 4 * u, out.gradient(i, k - 1) += 2 * u * x;
          if (order >= 2) {
            out.hessian(i, packed_index(k, k)) -= 4;
            out.hessian(i, packed_index(k, k - 1)) += 2 * x;
            out.hessian(i, packed_index(k - 1, k - 1)) += 2 * u - x * x;
          }
        }
        out.value[i] = value;
      }
    }
  } target;
  MapSolverOptions options;
  options.max_order = 2;
  MapSolver solver(options);
  const MapResult result = solver.solve(target);
  const auto corrected = solver.correct(target, result);
  EXPECT_EQ(result.order, 2);
  EXPECT_LT(result.verified_diagnostic, 0.02);
  EXPECT_NEAR(corrected.log_evidence, 0, 0.02);
  EXPECT_NEAR(corrected.mean[1], 0.25, 0.02);
}

}  // namespace
}  // namespace knothe::posterior
