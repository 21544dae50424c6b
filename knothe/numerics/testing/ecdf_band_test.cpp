#include "knothe/numerics/testing/ecdf_band.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::numerics {
namespace {

/// Share of 2,000 samples of Φ(spread · x), x ~ N(0, 1), that leave the band.
double share_outside(int n, double spread) {
  const EcdfBand band = simultaneous_ecdf_band(n, 50, 0.95);
  int outside = 0;
  const int repetitions = 2000;
  std::vector<double> sample(static_cast<std::size_t>(n));
  for (int r = 0; r < repetitions; ++r) {
    const Eigen::MatrixXd x = monte_carlo_normal_points(n, 1, static_cast<std::uint64_t>(1000 + r));
    for (Eigen::Index i = 0; i < n; ++i) sample[static_cast<std::size_t>(i)] = normal_cdf(spread * x(i, 0));
    outside += band.excess(sample) > 0;
  }
  return static_cast<double>(outside) / repetitions;
}

TEST(EcdfBand, OnePointIsTheBinomialInterval) {
  // 10 values, the point ½: P(2 ≤ R ≤ 8) = 1 − 2 (1 + 10)/1024; P(3 ≤ R ≤ 7) = 912/1024 is too little.
  const EcdfBand band = simultaneous_ecdf_band(10, 2, 0.95);
  EXPECT_EQ(band.lower[0], 2);
  EXPECT_EQ(band.upper[0], 8);
  EXPECT_NEAR(band.coverage, 1 - 22.0 / 1024, 1e-12);
}

TEST(EcdfBand, CoverageIsThatOfAllOutcomesCounted) {
  // 4 values in 3 intervals: all 3⁴ outcomes by hand.
  const EcdfBand band = simultaneous_ecdf_band(4, 3, 0.8);
  int inside = 0;
  for (int code = 0; code < 81; ++code) {
    int counts[2] = {0, 0}, rest = code;
    for (int value = 0; value < 4; ++value, rest /= 3) {
      counts[0] += rest % 3 == 0;
      counts[1] += rest % 3 <= 1;
    }
    inside += counts[0] >= band.lower[0] && counts[0] <= band.upper[0] && counts[1] >= band.lower[1] &&
              counts[1] <= band.upper[1];
  }
  EXPECT_NEAR(band.coverage, inside / 81.0, 1e-12);
  EXPECT_GE(band.coverage, 0.8);
}

TEST(EcdfBand, HoldsWithTheProbabilityAskedForAndFindsWrongSpreads) {
  for (int n : {100, 500}) {
    const EcdfBand band = simultaneous_ecdf_band(n, 50, 0.95);
    EXPECT_GE(band.coverage, 0.95);
    EXPECT_LT(band.coverage, 0.965);
    EXPECT_GT(band.pointwise_level, 0.95);
    EXPECT_NEAR(share_outside(n, 1), 1 - band.coverage, 4 * std::sqrt(0.05 * 0.95 / 2000));
  }
  EXPECT_GT(share_outside(1000, 1 / 1.3), 0.99);  // a posterior 1.3 times too wide
  EXPECT_GT(share_outside(1000, 1.3), 0.99);      // … and too narrow
}

TEST(EcdfBand, RefusesWhatMakesNoSense) {
  EXPECT_THROW((void)simultaneous_ecdf_band(1, 10, 0.95), UsageError);
  EXPECT_THROW((void)simultaneous_ecdf_band(10, 1, 0.95), UsageError);
  EXPECT_THROW((void)simultaneous_ecdf_band(10, 10, 1), UsageError);
  const EcdfBand band = simultaneous_ecdf_band(3, 3, 0.9);
  EXPECT_THROW((void)band.excess(std::vector<double>{0.1, 0.2}), UsageError);
  EXPECT_THROW((void)band.excess(std::vector<double>{0.1, 0.2, 1.5}), UsageError);
  EXPECT_THROW((void)band.excess(std::vector<double>{0.1, 0.2, std::numeric_limits<double>::quiet_NaN()}),
               UsageError);
}

}  // namespace
}  // namespace knothe::numerics
