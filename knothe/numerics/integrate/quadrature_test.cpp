#include "knothe/numerics/integrate/quadrature.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/hermite.hpp"
#include "knothe/numerics/integrate/sobol.hpp"

namespace knothe::numerics {
namespace {

TEST(Hermite, KnownPolynomials) {
  const double x = 1.3;
  std::vector<double> h(6);
  normalised_hermite(x, h);
  EXPECT_NEAR(h[2], (x * x - 1) / std::sqrt(2), 1e-14);
  EXPECT_NEAR(h[3], (x * x * x - 3 * x) / std::sqrt(6), 1e-14);
}

TEST(GaussHermite, IntegratesMomentsExactly) {
  for (int n : {1, 2, 5, 10, 20, 33, 64}) {
    const Quadrature rule = gauss_hermite(n);
    EXPECT_NEAR(rule.weights.sum(), 1, 1e-13);
    double moment = 1;  // E x^{2m} = (2m − 1)!!
    for (int m = 1; m <= std::min(n - 1, 12); ++m) {
      moment *= 2 * m - 1;
      EXPECT_NEAR((rule.weights.array() * rule.nodes.array().pow(2 * m)).sum() / moment, 1, 1e-12)
          << n << " " << m;
    }
    EXPECT_NEAR((rule.weights.array() * rule.nodes.array().cube()).sum(), 0, 1e-12);
  }
  EXPECT_NEAR(gauss_hermite(3).nodes[2], std::sqrt(3.0), 1e-15);
  EXPECT_NEAR(gauss_hermite(20).weights[0] / 1.257800672437921e-13, 1,
              1e-9);  // Abramowitz and Stegun, table 25.10, /√π
  EXPECT_THROW((void)gauss_hermite(0), UsageError);
}

TEST(GaussLegendre, IntegratesPolynomialsAndExponentials) {
  const Quadrature rule = gauss_legendre(5, 0, 2);
  EXPECT_NEAR((rule.weights.array() * rule.nodes.array().pow(9)).sum(), std::pow(2.0, 10) / 10, 1e-11);
  const Quadrature fine = gauss_legendre(20, -1, 3);
  EXPECT_NEAR((fine.weights.array() * fine.nodes.array().exp()).sum(), std::exp(3) - std::exp(-1), 1e-12);
}

TEST(TensorRule, IntegratesProducts) {
  const PointRule rule = tensor_rule(gauss_hermite(6), 3);
  EXPECT_EQ(rule.points.rows(), 216);
  const auto x = rule.points.array();
  EXPECT_NEAR((rule.weights.array() * x.col(0).square() * x.col(1).pow(4) * x.col(2).square()).sum(), 3,
              1e-12);
  EXPECT_EQ(rule.points(1, 1), rule.points(0, 1));  // the first coordinate runs fastest
  const PointRule fewer = tensor_rule(gauss_hermite(20), 2, 1e-10);
  EXPECT_LT(fewer.points.rows(), 300);
  EXPECT_NEAR(fewer.weights.sum(), 1, 1e-13);
  EXPECT_NEAR((fewer.weights.array() * fewer.points.col(0).array().pow(4)).sum(), 3, 1e-5);
}

TEST(Sobol, FirstPointsAreTheKnownOnes) {
  const Eigen::MatrixXd p = sobol_points(8, 3, 0);
  const double half = 0x1p-33;
  EXPECT_DOUBLE_EQ(p(1, 0), 0.5 + half);
  EXPECT_DOUBLE_EQ(p(2, 0), 0.75 + half);
  EXPECT_DOUBLE_EQ(p(2, 1), 0.25 + half);
  EXPECT_DOUBLE_EQ(p(4, 2), 0.625 + half);  // Joe and Kuo's programme: 0.375 0.375 0.625
  EXPECT_DOUBLE_EQ(p(4, 0), 0.375 + half);
}

/// Sobol's property A: each of the 2^d half-cubes holds one of the first 2^d points. Joe and Kuo's numbers
/// have it in every dimension, so that a wrong digit in the table is likely to show here.
TEST(Sobol, HasPropertyA) {
  for (std::uint64_t seed : {0u, 7u}) {
    for (Eigen::Index d : {2, 3, 5, 8, 11, 13}) {
      const Eigen::MatrixXd p = sobol_points(Eigen::Index{1} << d, d, seed);
      std::vector<int> hits(std::size_t{1} << d, 0);
      for (Eigen::Index i = 0; i < p.rows(); ++i) {
        std::size_t cell = 0;
        for (Eigen::Index k = 0; k < d; ++k) cell = 2 * cell + (p(i, k) >= 0.5);
        ++hits[cell];
      }
      for (int count : hits) ASSERT_EQ(count, 1) << d;
    }
  }
}

TEST(Sobol, ScrambledPointsAreBalancedSeededAndIntegrateWell) {
  const Eigen::MatrixXd p = sobol_points(1024, 40, 42), again = sobol_points(1024, 40, 42);
  EXPECT_TRUE((p.array() == again.array()).all());
  EXPECT_FALSE((p.array() == sobol_points(1024, 40, 43).array()).all());
  for (Eigen::Index k = 0; k < 40; ++k) {
    std::vector<int> hits(1024, 0);  // one point in each of 1,024 intervals, scrambled or not
    for (Eigen::Index i = 0; i < 1024; ++i) ++hits[static_cast<std::size_t>(p(i, k) * 1024)];
    for (int count : hits) ASSERT_EQ(count, 1);
  }
  const Eigen::MatrixXd z = sobol_normal_points(4096, 20, 5);
  for (Eigen::Index a = 0; a < 20; ++a) {
    EXPECT_NEAR(z.col(a).mean(), 0, 2e-3);
    EXPECT_NEAR(z.col(a).squaredNorm() / 4096, 1, 1e-2);
    for (Eigen::Index b = 0; b < a; ++b) EXPECT_NEAR(z.col(a).dot(z.col(b)) / 4096, 0, 2e-2);
  }
  EXPECT_THROW((void)sobol_points(8, 201, 1), UsageError);
}

}  // namespace
}  // namespace knothe::numerics
