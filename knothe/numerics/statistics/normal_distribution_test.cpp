#include "knothe/numerics/statistics/normal_distribution.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace knothe::numerics {
namespace {

// Reference values: continued fraction in 60-digit arithmetic (Python, decimal).

TEST(NormalDistribution, KnownValues) {
  EXPECT_DOUBLE_EQ(normal_pdf(0), 0.3989422804014327);
  EXPECT_DOUBLE_EQ(normal_cdf(0), 0.5);
  EXPECT_NEAR(normal_cdf(1.959963984540054), 0.975, 1e-15);
  EXPECT_NEAR(normal_cdf(-10) / 7.61985302416052545e-24, 1, 4e-15);
  EXPECT_NEAR(normal_cdf(-20) / 2.75362411860623373e-89, 1, 4e-15);
  EXPECT_NEAR(normal_cdf(-37.5) / 4.60535300958195519e-308, 1, 4e-15);
}

TEST(NormalDistribution, DistributionIsTheIntegralOfTheDensity) {
  // Continuity of the three branches, and Simpson's rule on the density.
  for (double x : {-12.0, -8.0, -7.99, -3.0, -0.5, 0.0, 1.0, 4.0}) {
    const double h = 1e-3;
    const double simpson = h / 3 * (normal_pdf(x - h) + 4 * normal_pdf(x) + normal_pdf(x + h));
    EXPECT_NEAR((normal_cdf(x + h) - normal_cdf(x - h)) / simpson, 1, 2e-9 + 1e-13 / simpson);
  }
}

TEST(NormalDistribution, LogarithmsAgree) {
  for (double x = -37; x < 8; x += 0.37)
    EXPECT_NEAR(normal_log_pdf(x), std::log(normal_pdf(x)), 1e-12 * (1 + x * x));
}

TEST(NormalDistribution, QuantileInvertsInBothTails) {
  for (double x = -37; x <= 0; x += 0.111) {
    EXPECT_NEAR(normal_quantile(normal_cdf(x)), x, 4e-15 * (1 + std::abs(x))) << x;
    if (x > -5) {
      EXPECT_NEAR(normal_quantile(normal_cdf(-x)), -x, 1e-16 / normal_pdf(x) + 1e-14) << x;
    }
  }
  EXPECT_EQ(normal_quantile(0.5), 0.0);
  EXPECT_EQ(normal_quantile(0), -std::numeric_limits<double>::infinity());
  EXPECT_EQ(normal_quantile(1), std::numeric_limits<double>::infinity());
  EXPECT_TRUE(std::isnan(normal_quantile(1.5)));
  EXPECT_LT(normal_quantile(std::numeric_limits<double>::min()), -37);
  EXPECT_TRUE(std::isfinite(normal_quantile(std::numeric_limits<double>::denorm_min())));
}

}  // namespace
}  // namespace knothe::numerics
