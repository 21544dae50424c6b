#include "knothe/numerics/statistics/chi_squared.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

namespace knothe::numerics {
namespace {

double single(double x, double degrees, double lambda) {
  return mean_noncentral_upper(x, degrees, std::array{lambda}, std::array{1.0});
}

TEST(ChiSquared, EvenDegreesAreAFiniteSum) {
  // For 2m degrees of freedom P(X > x) = e^−x/2 Σ_{j<m} (x/2)^j/j!: the Poisson distribution function.
  for (const int m : {1, 2, 5, 30, 300, 10000}) {
    for (const double shift : {-6.0, -2.0, 0.0, 1.0, 4.0, 8.0}) {
      const double x = 2 * m + shift * 2 * std::sqrt(static_cast<double>(m));
      if (x <= 0) continue;
      long double sum = 0;
      for (int j = 0; j < m; ++j)
        sum += std::exp(j * std::log(0.5L * x) - 0.5L * x - std::lgamma(static_cast<long double>(j + 1)));
      EXPECT_NEAR(chi_squared_upper(x, 2 * m) / static_cast<double>(sum), 1, 1e-10) << m << " " << x;
    }
  }
}

/// Data that fit exactly: P(a, x) < x^a e^−x / Γ(a + 1) · 1/(1 − x/(a + 1)) is nothing beside 1.
TEST(ChiSquared, ExactDataOverflowNothing) {
  for (const double a : {0.5, 30.0, 99.0, 101.0, 171.0, 500.0, 1e5})
    for (const double x : {0.0, 1e-300, 1e-30, 1e-12, 1e-4}) {
      const double upper = upper_gamma(a, x);
      EXPECT_LE(upper, 1) << a << " " << x;
      EXPECT_GE(upper, 1 - 2 * std::exp(a * std::log(std::max(x, 1e-300)) - x - std::lgamma(a + 1)) - 1e-15)
          << a << " " << x;
    }
  EXPECT_EQ(upper_gamma(150, 14.9), 1);
}

TEST(ChiSquared, OneDegreeIsTheNormalDistribution) {
  for (const double x : {1e-6, 0.3, 1.0, 4.0, 25.0, 100.0})
    EXPECT_NEAR(chi_squared_upper(x, 1) / std::erfc(std::sqrt(0.5 * x)), 1, 1e-12) << x;
}

/// Noncentral, one degree of freedom: P(|Z + √λ| > √x), in closed form; more degrees by convolution with a
/// central χ², a quadrature that shares nothing with the series.
double reference(double x, double degrees, double lambda) {
  const auto one = [&](double y) {
    if (y <= 0) return 1.0;
    const double s = std::sqrt(y), m = std::sqrt(lambda);
    return 0.5 * std::erfc((s - m) / std::sqrt(2.0)) + 0.5 * std::erfc((s + m) / std::sqrt(2.0));
  };
  if (degrees == 1) return one(x);
  // X = (Z + √λ)² + Y, Y central with degrees − 1, y = u² to take the root at 0 away.
  const double k = degrees - 1;
  double sum = 0;
  const int n = 40000;
  const double end = std::sqrt(k + 12 * std::sqrt(2 * k) + 60), h = end / n;
  for (int i = 0; i < n; ++i) {
    const double u = (i + 0.5) * h, y = u * u;
    const double density =
        std::exp((0.5 * k - 1) * std::log(y) - 0.5 * y - 0.5 * k * std::log(2.0) - std::lgamma(0.5 * k)) * 2 *
        u;
    sum += density * one(x - y) * h;
  }
  return sum;
}

TEST(ChiSquared, NoncentralTailsAgreeWithConvolution) {
  for (const double degrees : {1.0, 2.0, 7.0, 58.0}) {
    for (const double lambda : {0.0, 0.02, 1.0, 30.0, 1000.0}) {
      for (const double shift : {-3.0, 0.0, 2.0, 5.0}) {
        const double x = degrees + lambda + shift * std::sqrt(2 * degrees + 4 * lambda);
        if (x <= 0) continue;
        const double exact = reference(x, degrees, lambda);
        EXPECT_NEAR(single(x, degrees, lambda), exact, 1e-4 * exact + 1e-12)
            << degrees << " " << lambda << " " << x;
      }
    }
  }
}

TEST(ChiSquared, AMixtureIsTheMeanOfItsParts) {
  const std::vector<double> lambdas = {0, 3, 500, 39999, 41000, 1e9};
  const std::vector<double> weights = {0.1, 0.3, 0.2, 0, 0.15, 0.25};
  for (const double x : {10.0, 80.0, 40500.0}) {
    double mean = 0;
    for (std::size_t k = 0; k < 6; ++k) mean += weights[k] * single(x, 58, lambdas[k]);
    EXPECT_NEAR(mean_noncentral_upper(x, 58, lambdas, weights), mean, 1e-10);
  }
  // Where the normal distribution takes over there is no step to speak of.
  EXPECT_NEAR(single(40500, 58, 40000), single(40500, 58, 40001), 5e-3);
  EXPECT_EQ(mean_noncentral_upper(0, 58, lambdas, weights), 1);
}

}  // namespace
}  // namespace knothe::numerics
