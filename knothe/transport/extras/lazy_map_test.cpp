#include "knothe/transport/extras/lazy_map.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/sampling/testing/test_targets.hpp"
#include "knothe/transport/diagnose/map_evidence.hpp"
#include "knothe/transport/extras/map_distribution.hpp"
#include "knothe/transport/testing/lazy_map_targets.hpp"

namespace knothe::transport {
namespace {

TEST(LazyMap, NonlinearSubspaceIn50DimensionsAgainstDenseQuadratureIn3) {
  targets::NonlinearSubspace target(50);
  const auto exact = target.dense_quadrature();
  const LazyMapResult result = solve_lazy_map(target);
  EXPECT_TRUE(result.tolerance_reached) << result.reason;
  EXPECT_LT(result.verified_diagnostic, 0.5 * result.laplace_diagnostic);
  ASSERT_GE(result.layers.size(), 1U);
  EXPECT_LE(result.layers[0].rank, 3);
  EXPECT_LT(result.layers[0].eigenvalues[3],
            1e-6 * result.layers[0].eigenvalues[0]);  // three informed directions
  const ImportanceCorrection corrected = correct(result);
  EXPECT_TRUE(corrected.trusted);
  EXPECT_NEAR(corrected.log_evidence, exact.log_evidence, 0.02);
  EXPECT_NEAR(corrected.map_log_evidence, exact.log_evidence, 0.03);
  const Eigen::Vector3d mean = target.w.transpose() * corrected.mean;
  const Eigen::Matrix3d covariance = target.w.transpose() * corrected.covariance * target.w;
  for (Eigen::Index k = 0; k < 3; ++k) {
    const double std = std::sqrt(exact.covariance(k, k));
    EXPECT_NEAR(mean[k], exact.mean[k], 0.03 * std);
    EXPECT_NEAR(std::sqrt(covariance(k, k)) / std, 1, 0.03);
  }
  // Across the subspace nothing was learnt.
  const Eigen::MatrixXd across = Eigen::MatrixXd::Identity(50, 50) - target.w * target.w.transpose();
  EXPECT_LT((across * corrected.mean).cwiseAbs().maxCoeff(), 0.05);
  EXPECT_LT(
      (across * (corrected.covariance - Eigen::MatrixXd::Identity(50, 50)) * across).cwiseAbs().maxCoeff(),
      0.12);
  // The map's own distribution: inverse and density.
  const MapDistribution distribution(result.map);
  const Eigen::MatrixXd draws = distribution.sample(50, 3);
  EXPECT_LT((result.map.evaluate(result.map.inverse(draws)) - draws).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(LazyMap, LinearGaussianIn50DimensionsAgainstTheConjugateFormula) {
  // y = A z + e with 6 data: posterior precision I + AᵀA/σ², evidence N(y; 0, AAᵀ + σ²I).
  const Eigen::Index d = 50, m = 6;
  const Eigen::MatrixXd a = numerics::monte_carlo_normal_points(m, d, 5) / std::sqrt(10.0);
  const Eigen::VectorXd y = numerics::monte_carlo_normal_points(m, 1, 6);
  const double sigma = 0.3;
  const Eigen::MatrixXd precision = Eigen::MatrixXd::Identity(d, d) + a.transpose() * a / (sigma * sigma);
  const Eigen::MatrixXd covariance = precision.inverse();
  const Eigen::VectorXd mean = covariance * a.transpose() * y / (sigma * sigma);
  const Eigen::MatrixXd marginal = a * a.transpose() + sigma * sigma * Eigen::MatrixXd::Identity(m, m);
  const double log_evidence = -0.5 * y.dot(marginal.inverse() * y) - 0.5 * std::log(marginal.determinant()) -
                              0.5 * static_cast<double>(m) * std::log(2 * std::numbers::pi);
  sampling::targets::Gaussian target(mean, precision, log_evidence);
  target.derivatives = 1;
  {
    const LazyMapResult result = solve_lazy_map(target);  // Laplace is exact
    EXPECT_TRUE(result.tolerance_reached);
    EXPECT_TRUE(result.layers.empty());
    EXPECT_NEAR(result.map_log_evidence(), log_evidence, 1e-6);
    EXPECT_LT(result.half_trace, 1e-6);
    const auto corrected = correct(result);
    EXPECT_LT((corrected.mean - mean).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LT((corrected.covariance - covariance).cwiseAbs().maxCoeff(), 1e-5);
    EXPECT_GT(corrected.ess, 0.9999);
  }
  {  // without Laplace the subspace has to be found: six directions of H carry everything
    LazyMapOptions options;
    options.laplace = false;
    options.max_rank = 6;
    options.max_order = 1;
    const LazyMapResult result = solve_lazy_map(target, options);
    EXPECT_TRUE(result.tolerance_reached) << result.reason;
    EXPECT_EQ(result.layers.at(0).rank, 6);
    EXPECT_LT(result.layers[0].eigenvalues[6], 1e-8 * result.layers[0].eigenvalues[0]);
    EXPECT_NEAR(result.map_log_evidence(), log_evidence, 1e-3);
    const auto corrected = correct(result);
    EXPECT_LT((corrected.mean - mean).cwiseAbs().maxCoeff(), 0.02);
  }
}

TEST(LazyMap, LayersAreAddedGreedily) {
  targets::NonlinearSubspace target(12);
  LazyMapOptions options;
  options.max_rank = 1;
  options.max_layers = 5;
  options.tolerance = 2e-3;
  const LazyMapResult result = solve_lazy_map(target, options);
  ASSERT_GE(result.layers.size(), 2U);
  double last = result.laplace_diagnostic;
  for (const LazyLayer& layer : result.layers) {
    EXPECT_EQ(layer.rank, 1);
    EXPECT_LT(layer.verified_diagnostic, last);
    EXPECT_NEAR(layer.bound, 0.5 * layer.eigenvalues.tail(11).sum(), 1e-12);
    last = layer.verified_diagnostic;
  }
  // What is said is what an independent look says.
  const auto independent = estimate_evidence(result.map, target);
  EXPECT_NEAR(independent.diagnostic / result.verified_diagnostic, 1, 0.5);
  if (!result.tolerance_reached) {
    EXPECT_NE(result.reason.find("above the tolerance"), std::string::npos);
  }
}

TEST(LazyMap, IsDeterministicAndFindsASecondMode) {
  sampling::targets::Planar target(sampling::targets::mixture(5), 1);
  const LazyMapResult a = solve_lazy_map(target), b = solve_lazy_map(target);
  EXPECT_TRUE(a.second_mode_found);
  EXPECT_FALSE(correct(a).trusted);
  EXPECT_EQ(a.verified_diagnostic, b.verified_diagnostic);
  EXPECT_EQ(a.verification.points, b.verification.points);
}

TEST(LazyMap, MistakesAreExplained) {
  const auto message = [](sampling::LogDensity& target, const LazyMapOptions& options) {
    try {
      (void)solve_lazy_map(target, options);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  sampling::targets::Planar values_only(sampling::targets::banana(), 0),
      banana(sampling::targets::banana(), 1);
  EXPECT_NE(message(values_only, {}).find("no gradient"), std::string::npos);
  LazyMapOptions options;
  options.max_order = 0;
  EXPECT_NE(message(banana, options).find("order 0"), std::string::npos);
  options = {};
  options.tolerance = -1;
  EXPECT_NE(message(banana, options).find("tolerance -1"), std::string::npos);
  options = {};
  options.max_rank = 0;
  EXPECT_NE(message(banana, options).find("rank 0"), std::string::npos);
}

}  // namespace
}  // namespace knothe::transport
