#include "knothe/transport/extras/metropolis_correction.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/sampling/testing/test_targets.hpp"
#include "knothe/transport/diagnose/moments.hpp"
#include "knothe/transport/testing/map_examples.hpp"

namespace knothe::transport {
namespace {

/// An affine map for the banana y ~ N(0.6 x², 1): order 1, bad on purpose.
ComposedMap poor_map() {
  ComposedMap map(2);
  map.append(AffineMap{Eigen::Vector2d(0, 0.6), Eigen::Matrix2d{{1.3, 0}, {0, 3.0}}});
  return map;
}

TEST(MetropolisCorrection, ExactMomentsOfABananaThroughABadMap) {
  sampling::targets::Planar target(sampling::targets::banana(0.6), 0);
  MetropolisCorrectionOptions options;
  options.samples = 40000;
  const auto result = metropolis_correction(poor_map(), target, options);
  EXPECT_GT(result.acceptance, 0.3);
  EXPECT_LT(result.acceptance, 0.95);
  EXPECT_TRUE(result.converged);
  EXPECT_EQ(result.density_evaluations, 40000 + 4 * 100);
  const Moments m = moments_of(result.points, Eigen::VectorXd::Ones(result.points.rows()));
  // Standard errors from the effective sizes; x ~ N(0, 1), y: mean 0.6, variance 1 + 2·0.36.
  const double variance = 1.72;
  EXPECT_NEAR(m.mean[0], 0, 4 / std::sqrt(result.effective_sizes[0]));
  EXPECT_NEAR(m.mean[1], 0.6, 4 * std::sqrt(variance / result.effective_sizes[1]));
  EXPECT_NEAR(m.covariance(0, 0), 1, 0.05);
  EXPECT_NEAR(m.covariance(1, 1) / variance, 1, 0.06);
  EXPECT_NEAR(m.covariance(0, 1), 0, 0.05);
  EXPECT_NEAR(m.skewness[1], 8 * 0.216 / std::pow(variance, 1.5), 0.15);
}

TEST(MetropolisCorrection, RanksAreUniform) {
  // Φ(y − 0.6 x²) of thinned draws is uniform: Kolmogorov–Smirnov, 0.1 % level.
  sampling::targets::Planar target(sampling::targets::banana(0.6), 0);
  MetropolisCorrectionOptions options;
  options.samples = 40000;
  options.seed = 7;
  const auto result = metropolis_correction(poor_map(), target, options);
  std::vector<double> u;
  for (Eigen::Index i = 0; i < result.points.rows(); i += 20)
    u.push_back(numerics::normal_cdf(result.points(i, 1) - 0.6 * result.points(i, 0) * result.points(i, 0)));
  std::sort(u.begin(), u.end());
  double distance = 0;
  const auto n = static_cast<double>(u.size());
  for (std::size_t i = 0; i < u.size(); ++i)
    distance = std::max({distance, std::abs(u[i] - static_cast<double>(i) / n),
                         std::abs(u[i] - static_cast<double>(i + 1) / n)});
  EXPECT_LT(distance, 1.95 / std::sqrt(n));
}

TEST(MetropolisCorrection, AnExactMapIsAlwaysAccepted) {
  sampling::targets::Planar target(sampling::targets::banana(0.6), 0);
  MetropolisCorrectionOptions options;
  options.samples = 2000;
  const auto result = metropolis_correction(examples::banana_map(0.6), target, options);
  EXPECT_GT(result.acceptance, 0.999999);
  EXPECT_EQ(result.longest_stay, 1);
}

TEST(MetropolisCorrection, IsDeterministicWhateverTheBatch) {
  sampling::targets::Planar target(sampling::targets::banana(0.6), 0);
  MetropolisCorrectionOptions options;
  options.samples = 2000;
  const auto a = metropolis_correction(poor_map(), target, options);
  options.batch = 7;
  EXPECT_EQ(a.points, metropolis_correction(poor_map(), target, options).points);
  options.seed = 2;
  EXPECT_NE(a.points, metropolis_correction(poor_map(), target, options).points);
}

TEST(MetropolisCorrection, MistakesAreExplained) {
  const auto message = [](sampling::LogDensity& target, const MetropolisCorrectionOptions& options) {
    try {
      (void)metropolis_correction(poor_map(), target, options);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  sampling::targets::Planar target(sampling::targets::banana(0.6), 0);
  sampling::targets::Gaussian three(Eigen::Vector3d::Zero(), Eigen::Matrix3d::Identity());
  MetropolisCorrectionOptions options;
  EXPECT_NE(message(three, options).find("2 variables for a density in 3"), std::string::npos);
  options.chains = 0;
  EXPECT_NE(message(target, options).find("0 chains"), std::string::npos);
  options = {};
  options.progress = [](double) { return false; };
  EXPECT_NE(message(target, options).find("interrupted"), std::string::npos);
  sampling::targets::Planar nowhere(
      [](double, double, double* r) { r[0] = -std::numeric_limits<double>::infinity(); }, 0);
  EXPECT_NE(message(nowhere, {}).find("zero at every proposal"), std::string::npos);
}

}  // namespace
}  // namespace knothe::transport
