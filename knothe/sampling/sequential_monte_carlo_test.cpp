#include "knothe/sampling/sequential_monte_carlo.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/sampling/testing/test_targets.hpp"

namespace knothe::sampling {
namespace {

using targets::Gaussian;
using targets::Planar;

TEST(SequentialMonteCarlo, GaussianMomentsAndEvidence) {
  Eigen::MatrixXd a = Eigen::MatrixXd::Identity(3, 3);
  a(1, 0) = 0.8, a(2, 0) = -0.5, a(2, 1) = 0.9;
  Gaussian target(Eigen::Vector3d(0.5, -1, 1.5), 9 * a * a.transpose(), -3.25);
  const auto result = sequential_monte_carlo(target, {.particles = 4000, .seed = 2});
  const WeightedSample& sample = result.sample;
  ASSERT_TRUE(sample.has_evidence);
  EXPECT_NEAR(sample.log_evidence, -3.25, 4 * sample.log_evidence_error);
  EXPECT_LT(sample.log_evidence_error, 0.1);
  EXPECT_GT(sample.effective_size, 1000);
  const Eigen::MatrixXd covariance = target.precision.inverse();
  for (Eigen::Index i = 0; i < 3; ++i) {
    EXPECT_NEAR(mean_of(sample)[i], target.mean[i],
                4.5 * std::sqrt(covariance(i, i) / sample.effective_size));
    EXPECT_NEAR(covariance_of(sample)(i, i) / covariance(i, i), 1, 0.15);
  }
  EXPECT_EQ(result.temperatures.front(), 0);
  EXPECT_EQ(result.temperatures.back(), 1);
  for (std::size_t k = 1; k < result.temperatures.size(); ++k)
    EXPECT_GT(result.temperatures[k], result.temperatures[k - 1]);
}

TEST(SequentialMonteCarlo, TheErrorBarOfTheEvidenceIsHonest) {
  // Over many seeds the deviations, in units of the reported standard error, have mean square 1.
  Gaussian far(Eigen::Vector2d(1.5, -1), 400 * Eigen::Matrix2d::Identity(), 1.0);
  Planar bimodal(targets::mixture(4, 0.3));
  double squares = 0, mean = 0;
  const int n = 40;
  for (int seed = 1; seed <= n; ++seed) {
    LogDensity& target = seed % 2 == 0 ? static_cast<LogDensity&>(far) : bimodal;
    const auto result = sequential_monte_carlo(target, {.particles = 400,
                                                        .initial_spread = seed % 2 == 0 ? 1.5 : 4,
                                                        .seed = static_cast<std::uint64_t>(seed)});
    const double exact = seed % 2 == 0 ? 1.0 : 0.0;
    const double z = (result.sample.log_evidence - exact) / result.sample.log_evidence_error;
    squares += z * z / n;
    mean += z / n;
  }
  EXPECT_LT(squares, 2.0);  // χ²/40: 99.9 % of honest bars lie in 0.45 … 1.85
  EXPECT_GT(squares, 0.3);
  EXPECT_LT(std::abs(mean), 0.6);
}

TEST(SequentialMonteCarlo, TwoModesWithTheirWeights) {
  Planar target(targets::mixture(6, 0.3));
  const auto result = sequential_monte_carlo(target, {.particles = 4000, .initial_spread = 5, .seed = 3});
  EXPECT_NEAR(result.sample.log_evidence, 0, 4 * result.sample.log_evidence_error);
  const double left = (result.sample.points.col(0).array() < 0).cast<double>().mean();
  EXPECT_NEAR(left, 0.3, 0.06);
  EXPECT_NEAR(covariance_of(result.sample)(1, 1), 1, 0.15);
}

TEST(SequentialMonteCarlo, TheBananaAndAnExactAnswerByQuadrature) {
  Planar banana(targets::banana());
  const auto bent = sequential_monte_carlo(banana, {.particles = 4000, .initial_spread = 3, .seed = 1});
  EXPECT_NEAR(bent.sample.log_evidence, 0, 4 * bent.sample.log_evidence_error);
  EXPECT_NEAR(mean_of(bent.sample)[1], 1, 0.15);
  const targets::Ridge ridge{1, 1.05, 0.02, 1.2, 0.2};
  const auto reference = targets::dense_quadrature(ridge, {0.5});
  Planar target(ridge);
  const auto narrow = sequential_monte_carlo(target, {.particles = 4000, .seed = 1});
  EXPECT_NEAR(narrow.sample.log_evidence, reference.log_evidence, 4 * narrow.sample.log_evidence_error);
  for (Eigen::Index i = 0; i < 2; ++i)
    EXPECT_NEAR(mean_of(narrow.sample)[i], reference.mean[i],
                5 * reference.standard_deviation[i] / std::sqrt(narrow.sample.effective_size));
}

TEST(SequentialMonteCarlo, ZeroDensityOutsideABox) {
  Planar target(
      [](double x, double y, double* r) {
        r[0] = x > 0 && x < 1 && y > 0 && y < 0.5 ? 0 : -std::numeric_limits<double>::infinity();
      },
      0);
  const auto result = sequential_monte_carlo(target, {.particles = 2000, .seed = 1});
  EXPECT_NEAR(result.sample.log_evidence, std::log(0.5), 4 * result.sample.log_evidence_error);
  Planar nowhere([](double, double, double* r) { r[0] = -std::numeric_limits<double>::infinity(); }, 0);
  try {
    (void)sequential_monte_carlo(nowhere, {.particles = 64});
    FAIL();
  } catch (const NumericalError& error) {
    EXPECT_EQ(
        std::string(error.what()),
        "smc: the density is zero at all 64 first particles; give a centre and a spread where its mass is");
  }
}

TEST(SequentialMonteCarlo, OneParticleWhereTheDensityIsNotZeroIsEnoughToGoOn) {
  // A box so small that one or none of 64 particles falls into it at first.
  Planar target(
      [](double x, double y, double* r) {
        r[0] = std::abs(x) < 0.2 && std::abs(y) < 0.2 ? 0 : -std::numeric_limits<double>::infinity();
      },
      0);
  int survived = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    try {
      const auto result = sequential_monte_carlo(target, {.particles = 64, .seed = seed});
      EXPECT_TRUE(std::isfinite(result.sample.log_evidence));
      EXPECT_TRUE(result.sample.points.allFinite());
      ++survived;
    } catch (const NumericalError&) {
    }
  }
  EXPECT_GT(survived, 5);
}

TEST(SequentialMonteCarlo, TheSameSeedGivesTheSameParticles) {
  Planar target(targets::banana());
  const auto run = [&](std::uint64_t seed) {
    return sequential_monte_carlo(target, {.particles = 200, .seed = seed}).sample.points;
  };
  const Eigen::MatrixXd first = run(7);
  EXPECT_NE(first, run(8));
  EXPECT_EQ(first, run(7));
}

TEST(SequentialMonteCarlo, ProgressAndInterruption) {
  Planar target(targets::Ridge{1, 1.05, 0.02, 1.2, 0.2});
  double last = -1;
  (void)sequential_monte_carlo(target, {.particles = 200, .progress = [&](double beta) {
                                          EXPECT_GE(beta, last);
                                          last = beta;
                                          return true;
                                        }});
  EXPECT_EQ(last, 1);
  try {
    (void)sequential_monte_carlo(target, {.particles = 200, .progress = [](double) { return false; }});
    FAIL();
  } catch (const Interrupted& error) {
    EXPECT_EQ(std::string(error.what()), "smc: interrupted at temperature 0 of 1");
  }
}

TEST(SequentialMonteCarlo, BadOptionsAreRefused) {
  Planar target(targets::banana());
  const auto message = [&](const SequentialMonteCarloOptions& options) {
    try {
      (void)sequential_monte_carlo(target, options);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message({.particles = 3}), "smc: 3 particles; at least 16 are needed");
  EXPECT_EQ(message({.ess_share = 1}), "smc: ess_share is 1; it must lie between 0 and 1, both excluded");
  EXPECT_EQ(message({.max_moves = 0}), "smc: max_moves is 0");
  EXPECT_EQ(message({.initial_spread = 0}), "smc: the initial spread 0 is not positive");
  EXPECT_EQ(message({.centre = Eigen::Vector3d(0, 0, 0)}),
            "smc: the centre has 3 coordinates, the density 2");
}

}  // namespace
}  // namespace knothe::sampling
