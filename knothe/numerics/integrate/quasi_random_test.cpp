#include <gtest/gtest.h>
#include <algorithm>

#include <bit>
#include <bitset>
#include <boost/random/sobol.hpp>
#include <cmath>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::numerics {
namespace {

struct SobolDirection {
  std::uint32_t degree, inner;
  std::vector<std::uint16_t> m;
};

/// Of Boost's table what the dimensions 2 … 200 use.
std::vector<SobolDirection> joe_kuo() {
  using Table = boost::random::default_sobol_table;
  std::vector<SobolDirection> rows;
  for (std::size_t j = 0; j + 1 < k_sobol_max_dimension; ++j) {
    const std::uint32_t polynomial = Table::polynomial(j), degree = std::bit_width(polynomial) - 1;
    rows.push_back({degree, (polynomial ^ 1u << degree) >> 1, {}});
    for (std::uint32_t k = 0; k < degree; ++k) rows.back().m.push_back(Table::minit(j, k));
  }
  return rows;
}
const std::vector<SobolDirection> k_joe_kuo = joe_kuo();

TEST(SobolDirections, AreThoseThatSeedsWereGivenFor) {
  // FNV-1a of the table of new-joe-kuo-6 to 200 dimensions: the points of every seed stay what they were.
  std::uint64_t sum = 0xcbf29ce484222325;
  const auto add = [&sum](std::uint64_t number) { sum = (sum ^ number) * 0x100000001b3; };
  for (const auto& [degree, inner, m] : k_joe_kuo) {
    add(degree), add(inner);
    for (const auto number : m) add(number);
  }
  EXPECT_EQ(sum, 0xd6a4147edb0153e1);
}

/// a(x) b(x) modulo the polynomial f of the given degree over the field of two elements.
std::uint32_t multiply_modulo(std::uint32_t a, std::uint32_t b, std::uint32_t f, std::uint32_t degree) {
  std::uint32_t product = 0;
  for (; b != 0; b >>= 1) {
    if (b & 1u) product ^= a;
    a <<= 1;
    if (a >> degree & 1u) a ^= f;
  }
  return product;
}

/// Whether x generates all 2^degree − 1 non-zero remainders.
bool is_primitive(std::uint32_t f, std::uint32_t degree) {
  const std::uint32_t order = (1u << degree) - 1, x = degree > 1 ? 2u : 1u;
  std::uint32_t power = x, steps = 1;
  for (; power != 1 && steps <= order; ++steps) power = multiply_modulo(power, x, f, degree);
  return steps == order || degree == 1;
}

TEST(SobolDirections, AreAllPrimitivePolynomialsInOrderWithOddNumbers) {
  std::size_t at = 0;
  for (std::uint32_t degree = 1; degree <= 11 && at < k_joe_kuo.size(); ++degree)
    for (std::uint32_t inner = 0; inner < 1u << (degree - 1) && at < k_joe_kuo.size(); ++inner) {
      if (!is_primitive(1u << degree | inner << 1 | 1u, degree)) continue;
      EXPECT_EQ(k_joe_kuo[at].degree, degree) << at;
      EXPECT_EQ(k_joe_kuo[at].inner, inner) << at;
      for (std::uint32_t k = 0; k < degree; ++k) {
        EXPECT_EQ(k_joe_kuo[at].m[k] % 2, 1) << at;
        EXPECT_LT(k_joe_kuo[at].m[k], 2u << k) << at;
      }
      ++at;
    }
  EXPECT_EQ(at, k_joe_kuo.size());
}

/// Sobol's property A: each half-cube holds one of the first 2^d points, that is, the d × d matrix of leading
/// bits of the first d directions is regular. Joe and Kuo's numbers have it for every d.
TEST(SobolDirections, HavePropertyAInEveryDimensionTo200) {
  constexpr std::size_t n = 200;
  std::vector<std::bitset<n>> leading(n);
  leading[0][0] = true;
  for (std::size_t j = 1; j < n; ++j) {
    const auto& [degree, inner, m] = k_joe_kuo[j - 1];
    for (std::size_t k = 0; k < n; ++k) {
      if (k < degree) {
        leading[j][k] = m[k] >> k & 1;
        continue;
      }
      bool bit = leading[j][k - degree];  // what is shifted in does not reach the leading bit
      for (std::uint32_t i = 1; i < degree; ++i)
        if (inner >> (degree - 1 - i) & 1u) bit = bit != leading[j][k - i];
      leading[j][k] = bit;
    }
  }
  for (std::size_t d = 1; d <= n; ++d) {
    auto rows = leading;
    for (std::size_t c = 0; c < d; ++c) {
      std::size_t pivot = c;
      while (pivot < d && !rows[pivot][c]) ++pivot;
      ASSERT_LT(pivot, d) << "dimension " << d;
      std::swap(rows[c], rows[pivot]);
      for (std::size_t i = c + 1; i < d; ++i)
        if (rows[i][c]) rows[i] ^= rows[c];
    }
  }
}

TEST(Sobol, EveryFourthPointInTheOrderOfReversedBitsIsSpreadEvenly) {
  const Eigen::MatrixXd points = sobol_points(1024, 3, 1);
  const std::vector<Eigen::Index> order = reversed_bits(1024);
  Eigen::RowVector3d plain = Eigen::RowVector3d::Zero(), reversed = plain;
  for (Eigen::Index i = 2; i < 1024; i += 4) {
    plain += points.row(i) / 256;
    reversed += points.row(order[static_cast<std::size_t>(i)]) / 256;
  }
  EXPECT_GT((plain.array() - 0.5).abs().maxCoeff(), 0.1);
  EXPECT_LT((reversed.array() - 0.5).abs().maxCoeff(), 1e-2);
  std::vector<Eigen::Index> all = reversed_bits(1000);  // not a power of two
  std::sort(all.begin(), all.end());
  ASSERT_EQ(all.size(), 1000U);
  for (Eigen::Index i = 0; i < 1000; ++i) EXPECT_EQ(all[static_cast<std::size_t>(i)], i);
}

TEST(Sobol, EveryCoordinateIsANetTo200Dimensions) {
  for (std::uint64_t seed : {0u, 3u}) {
    const Eigen::MatrixXd p = sobol_points(256, 200, seed);
    for (Eigen::Index k = 0; k < 200; ++k) {
      std::vector<int> hits(256, 0);
      for (Eigen::Index i = 0; i < 256; ++i) ++hits[static_cast<std::size_t>(p(i, k) * 256)];
      for (int count : hits) ASSERT_EQ(count, 1) << k;
    }
  }
}

/// Warnock's formula for the squared L2 star discrepancy.
double l2_star_discrepancy(const Eigen::MatrixXd& x) {
  const Eigen::Index n = x.rows(), d = x.cols();
  double single = 0, pairs = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    single += (0.5 * (1 - x.row(i).array().square())).prod();
    for (Eigen::Index j = 0; j < n; ++j) pairs += (1 - x.row(i).array().max(x.row(j).array())).prod();
  }
  const double count = static_cast<double>(n);
  return std::pow(3.0, -static_cast<double>(d)) - 2 * single / count + pairs / (count * count);
}

/// Mean of the squared discrepancy of n independent points: (2^{−d} − 3^{−d})/n.
double random_discrepancy(double n, double d) {
  return (std::pow(2.0, -d) - std::pow(3.0, -d)) / n;
}

TEST(QuasiRandom, DiscrepancyIsFarBelowThatOfIndependentPoints) {
  for (Eigen::Index d : {2, 4, 8}) {
    const double random = random_discrepancy(1024, static_cast<double>(d));
    const double bound = d == 2 ? 0.02 : d == 4 ? 0.1 : 0.6;
    EXPECT_LT(l2_star_discrepancy(sobol_points(1024, d, 11)), bound * random) << d;
    double mean = 0;
    for (std::uint64_t seed = 1; seed <= 8; ++seed)
      mean += l2_star_discrepancy(monte_carlo_points(1024, d, seed)) / 8;
    EXPECT_NEAR(mean / random, 1, 0.6) << d;
  }
}

/// Mean squared error, over seeds, of the average of Σ_k (x_k − ½) + Σ_k (x_k − ½)(x_{k+1} − ½), relative to
/// independent points.
template <class Points>
double relative_variance(Eigen::Index n, Eigen::Index d, const Points& points) {
  double sum = 0;
  const int seeds = 20;
  for (int seed = 1; seed <= seeds; ++seed) {
    const Eigen::ArrayXXd x = points(n, d, static_cast<std::uint64_t>(seed)).array() - 0.5;
    const double mean = (x.rowwise().sum() + (x.leftCols(d - 1) * x.rightCols(d - 1)).rowwise().sum()).mean();
    sum += mean * mean / seeds;
  }
  const double variance = static_cast<double>(d) / 12 + static_cast<double>(d - 1) / 144;
  return sum / (variance / static_cast<double>(n));
}

TEST(QuasiRandom, BeatsIndependentPointsInHighDimensions) {
  for (Eigen::Index d : {60, 200}) {
    const double sobol =
        relative_variance(1024, d, [](auto n, auto k, auto s) { return sobol_points(n, k, s); });
    const double random =
        relative_variance(1024, d, [](auto n, auto k, auto s) { return monte_carlo_points(n, k, s); });
    EXPECT_LT(sobol, 0.2) << d;
    EXPECT_NEAR(random, 1, 1.3) << d;  // χ² with 20 degrees of freedom: 1 ± 0.32
  }
}

TEST(Random, PhiloxGivesThePublishedNumbers) {
  // Known answers published with the reference implementation (Random123, philox4x32-10).
  using Four = std::array<std::uint32_t, 4>;
  EXPECT_EQ(philox({0, 0, 0, 0}, {0, 0}), (Four{0x6627e8d5u, 0xe169c58du, 0xbc57ac4cu, 0x9b00dbd8u}));
  EXPECT_EQ(philox({~0u, ~0u, ~0u, ~0u}, {~0u, ~0u}),
            (Four{0x408f276du, 0x41c83b0eu, 0xa20bc7c6u, 0x6d5451fdu}));
  EXPECT_EQ(philox({0x243f6a88u, 0x85a308d3u, 0x13198a2eu, 0x03707344u}, {0xa4093822u, 0x299f31d0u}),
            (Four{0xd16cfe09u, 0x94fdccebu, 0x5001e420u, 0x24126ea1u}));
  EXPECT_GT(unit_interval(0), 0);
  EXPECT_LT(unit_interval(~std::uint64_t{0}), 1);
  EXPECT_EQ(unit_interval(0), 1 - unit_interval(~std::uint64_t{0}));
}

TEST(Random, NormalPointsHaveNormalMomentsAndComeInPieces) {
  const Eigen::Index n = 20000;
  const Eigen::MatrixXd z = monte_carlo_normal_points(n, 5, 77);
  const double root = std::sqrt(static_cast<double>(n));
  for (Eigen::Index k = 0; k < 5; ++k) {
    EXPECT_NEAR(z.col(k).mean(), 0, 4 / root);
    EXPECT_NEAR(z.col(k).array().square().mean(), 1, 4 * std::sqrt(2.0) / root);
    EXPECT_NEAR(z.col(k).array().pow(4).mean(), 3, 4 * std::sqrt(96.0) / root);
    for (Eigen::Index l = 0; l < k; ++l) EXPECT_NEAR(z.col(k).dot(z.col(l)) / root / root, 0, 4 / root);
  }
  EXPECT_TRUE(
      (z.middleRows(100, 50).leftCols(3).array() == monte_carlo_normal_points(50, 3, 77, 100).array()).all());
}

TEST(Sobol, NormalPointsIntegrateAndTheirMomentsAreMatched) {
  const Eigen::MatrixXd x = sobol_normal_points(4096, 3, 3);
  const Eigen::ArrayXd f = (0.5 * x.col(0) + 0.2 * x.col(1) - 0.3 * x.col(2)).array().exp();
  EXPECT_NEAR(f.mean() / std::exp(0.5 * (0.25 + 0.04 + 0.09)), 1, 5e-3);
  for (Eigen::MatrixXd points : {sobol_normal_points(4096, 50, 3), monte_carlo_normal_points(4096, 50, 3)}) {
    match_standard_moments(points);
    EXPECT_LT(points.colwise().mean().cwiseAbs().maxCoeff(), 1e-13);
    const Eigen::MatrixXd covariance = points.transpose() * points / 4096.0;
    EXPECT_LT((covariance - Eigen::MatrixXd::Identity(50, 50)).cwiseAbs().maxCoeff(), 1e-12);
  }
}

TEST(Sobol, RefusesDimensionsThatItDoesNotHave) {
  EXPECT_THROW((void)sobol_points(8, 0, 1), UsageError);
  EXPECT_THROW((void)sobol_points(8, 201, 1), UsageError);
}

}  // namespace
}  // namespace knothe::numerics
