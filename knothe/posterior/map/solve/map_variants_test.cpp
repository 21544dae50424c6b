/// @file Every rectifier: derivatives against finite differences, the kernel against the
/// readable evaluation, integrals against a composite rule, inverses, other index sets, messages.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/map/rectifier.hpp"
#include "knothe/posterior/map/testing/map_examples.hpp"
#include "knothe/posterior/map/triangular_map.hpp"

namespace knothe::posterior {
namespace {

using examples::multi_index;
using Values = OneVariableBasis::Values;
constexpr Parametrisation k_softplus{Rectifier::softplus, {}};

std::vector<Parametrisation> all_parametrisations() {
  std::vector<Parametrisation> all;
  for (auto rectifier : {Rectifier::square, Rectifier::softplus, Rectifier::exponential})
    all.push_back({rectifier, {}});
  return all;
}

class EveryParametrisation : public testing::TestWithParam<Parametrisation> {};
INSTANTIATE_TEST_SUITE_P(Map, EveryParametrisation, testing::ValuesIn(all_parametrisations()),
                         [](const auto& choice) { return to_text(choice.param.rectifier); });

TriangularMap with_random_coefficients(MapSpecification specification, unsigned seed, double size) {
  TriangularMap map(std::move(specification));
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  Eigen::VectorXd a = map.coefficients();
  for (Eigen::Index i = 0; i < a.size(); ++i) a[i] += size * normal(generator);
  map.set_coefficients(a);
  return map;
}

Eigen::MatrixXd random_points(Eigen::Index n, Eigen::Index d, unsigned seed, double scale) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal(0, scale);
  Eigen::MatrixXd x(n, d);
  for (Eigen::Index i = 0; i < x.size(); ++i) x.data()[i] = normal(generator);
  return x;
}

double largest_difference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  double worst = 0;
  for (Eigen::Index i = 0; i < a.size(); ++i)
    worst = std::max(worst, std::abs(a.data()[i] - b.data()[i]) / (1 + std::abs(b.data()[i])));
  return worst;
}

TEST_P(EveryParametrisation, OneVariableFunctionsAndTheirDerivatives) {
  const OneVariableBasis basis(GetParam());
  const double e = 1e-5;
  Values v{}, f{}, s{}, up{}, down{}, f_up{}, f_down{}, unused{};
  for (bool monotone : {false, true})
    for (double x : {-70.0, -4.2, -3.3, -2.7, -1.1, 0.0, 0.4, 2.2, 2.8, 3.7, 12.0}) {
      const auto at = [&](double t, Values& a, Values& b, Values& c) {
        monotone ? basis.monotone(t, 7, a, b, c) : basis.constant(t, 7, a, b, c);
      };
      at(x, v, f, s), at(x + e, up, f_up, unused), at(x - e, down, f_down, unused);
      for (std::size_t j = 0; j <= 7; ++j) {
        const double scale = 1 + std::abs(v[j]) + std::abs(f[j]) + std::abs(s[j]);
        EXPECT_NEAR(f[j], (up[j] - down[j]) / (2 * e), 1e-7 * scale) << x << " " << j;
        EXPECT_NEAR(s[j], (f_up[j] - f_down[j]) / (2 * e), 1e-7 * scale) << x << " " << j;
      }
    }
}

TEST_P(EveryParametrisation, RuleAgainstACompositeRuleThatDoesNotKnowThePieces) {
  const OneVariableBasis basis(GetParam());
  const Rectifier rectifier = GetParam().rectifier;
  std::mt19937 generator(3);
  std::normal_distribution<double> normal;
  Values v{}, unused{}, unused2{}, b{};
  IntegrationRule rule;
  const UnitRule& unit = unit_rule(5);
  for (int n : {0, 2, 5}) {
    for (std::size_t j = 0; j <= static_cast<std::size_t>(n); ++j)
      b[j] = (j == 0 ? 1 : 0) + 0.2 * normal(generator) / static_cast<double>(j + 1);
    const auto integrand = [&](double t) {
      basis.monotone(t, n, v, unused, unused2);
      double h = 0;
      for (std::size_t j = 0; j <= static_cast<std::size_t>(n); ++j) h += b[j] * v[j];
      return rectify(rectifier, h).value;
    };
    for (double x : {-5.0, -2.9, -0.2, 0.0, 1.3, 3.2, 4.5}) {
      basis.integration_rule(x, n, rule);
      double sum = 0, expected = 0;
      for (std::size_t q = 0; q < rule.node.size(); ++q) sum += rule.weight[q] * integrand(rule.node[q]);
      const int pieces = 1000;
      for (int i = 0; i < pieces; ++i)
        for (std::size_t q = 0; q < unit.node.size(); ++q)
          expected += x / pieces * unit.weight[q] * integrand(x * (i + unit.node[q]) / pieces);
      EXPECT_NEAR(sum, expected, 1e-9 * (std::abs(expected) + 1e-3)) << n << " " << x;  // its kinks limit it
    }
  }
}

TEST_P(EveryParametrisation, StartsAsTheIdentity) {
  const TriangularMap map(total_order_map(3, 3, GetParam()));
  const Eigen::MatrixXd x = random_points(70, 3, 1, 3);
  const Eigen::MatrixXd image = map.evaluate(x);
  EXPECT_LT(largest_difference(image, x), 1e-13);
  EXPECT_LT(map.log_determinant(x).cwiseAbs().maxCoeff(), 1e-13);
}

TEST_P(EveryParametrisation, DerivativesInXAgainstFiniteDifferences) {
  const Eigen::Index d = 3, packed = 6;
  const TriangularMap map = with_random_coefficients(total_order_map(d, 3, GetParam()), 5, 0.1);
  const Eigen::MatrixXd x = random_points(25, d, 6, 1.6);
  const double e = 1e-5;
  MapBatch at, up, down;
  map.evaluate(x, 2, at);
  for (Eigen::Index a = 0; a < d; ++a) {
    Eigen::MatrixXd moved = x;
    for (Eigen::Index i = 0; i < x.rows(); ++i) moved(i, a) = x(i, a) + e;
    map.evaluate(moved, 1, up);
    for (Eigen::Index i = 0; i < x.rows(); ++i) moved(i, a) = x(i, a) - e;
    map.evaluate(moved, 1, down);
    for (Eigen::Index i = 0; i < x.rows(); ++i)
      for (Eigen::Index k = 0; k < d; ++k) {
        const double first = (up.value(i, k) - down.value(i, k)) / (2 * e);
        EXPECT_NEAR(at.jacobian(i, k * d + a), first, 1e-6 * (1 + std::abs(first)));
        for (Eigen::Index b = 0; b < d; ++b) {
          const double second = (up.jacobian(i, k * d + b) - down.jacobian(i, k * d + b)) / (2 * e);
          EXPECT_NEAR(at.hessian(i, k * packed + packed_index(a, b)), second, 1e-5 * (1 + std::abs(second)));
        }
      }
  }
  for (Eigen::Index i = 0; i < x.rows(); ++i) {  // triangular, increasing, log det = Σ log of the diagonal
    double sum = 0;
    for (Eigen::Index k = 0; k < d; ++k) {
      EXPECT_GT(at.jacobian(i, k * d + k), 0);
      sum += std::log(at.jacobian(i, k * d + k));
      for (Eigen::Index a = k + 1; a < d; ++a) EXPECT_EQ(at.jacobian(i, k * d + a), 0);
    }
    EXPECT_NEAR(at.log_determinant[i], sum, 1e-10 * (1 + std::abs(sum)));
  }
}

TEST_P(EveryParametrisation, KernelIsTheReadableEvaluation) {
  for (const Eigen::Index n : {1, 63, 64, 130}) {
    const TriangularMap map = with_random_coefficients(total_order_map(3, 4, GetParam()), 11, 0.1);
    const Eigen::MatrixXd x = random_points(n, 3, 12, 1.8);
    MapBatch readable, fast;
    map.evaluate(x, 1, readable);
    map.evaluate(x, 0, fast);
    EXPECT_LT(largest_difference(fast.value, readable.value), 1e-12);
    EXPECT_LT(largest_difference(fast.log_determinant, readable.log_determinant), 1e-12);
  }
}

TEST_P(EveryParametrisation, InverseRoundTrip) {
  const TriangularMap map = with_random_coefficients(total_order_map(3, 4, GetParam()), 21, 0.05);
  Eigen::MatrixXd x = random_points(150, 3, 22, 1.5);
  for (Eigen::Index k = 0; k < 3; ++k) x(0, k) = 7, x(1, k) = -7, x(2, k) = 0;
  const Eigen::MatrixXd z = map.evaluate(x), back = map.inverse(z);
  EXPECT_LT(largest_difference(map.evaluate(back), z), 1e-10);
  Eigen::MatrixXd far(2, 3);
  far << 1e6, -1e6, 1e3, -1e3, 1e5, -1e6;
  EXPECT_TRUE(map.inverse(far).allFinite());
}

TEST_P(EveryParametrisation, FarAwayAndSteepStaysFiniteAndIncreasing) {
  const TriangularMap map = with_random_coefficients(total_order_map(1, 6, GetParam()), 31, 1.0);
  Eigen::MatrixXd x(81, 1);
  for (Eigen::Index i = 0; i < 81; ++i) x(i, 0) = 0.25 * static_cast<double>(i - 40);
  MapBatch batch;
  map.evaluate(x, 2, batch);
  EXPECT_TRUE(batch.value.allFinite() && batch.jacobian.allFinite() && batch.hessian.allFinite());
  for (Eigen::Index i = 1; i < 81; ++i)
    EXPECT_GE(batch.value(i, 0), batch.value(i - 1, 0) - 1e-9 * std::abs(batch.value(i, 0))) << x(i, 0);
  Eigen::MatrixXd far(2, 1);
  far << 1e6, -1e6;
  map.evaluate(far, 1, batch);
  EXPECT_TRUE(batch.value.allFinite() && batch.jacobian.allFinite());
}

TEST(TriangularMap, OtherIndexSetsInKernelAndInverse) {
  std::vector<MapSpecification> specifications{
      sparse_map(total_order_map(4, 3, k_softplus), {{}, {}, {}, {}}),
      sparse_map(total_order_map(4, 3), {{}, {0}, {1}, {0}})};
  const int orders[] = {1, 4, 2};
  specifications.push_back(per_variable_map(orders));
  // By hand, not downward closed, in no particular order.
  const int high[] = {0, 3}, mixed[] = {2, 1}, empty[] = {0};
  specifications.push_back({{},
                            {{{MultiIndex{}}, {multi_index(empty)}},
                             {{MultiIndex{}}, {multi_index(mixed), multi_index(high), MultiIndex{}}}}});
  for (const MapSpecification& specification : specifications) {
    const TriangularMap map = with_random_coefficients(specification, 3, 0.1);
    EXPECT_EQ(map.coefficients().size(), specification.coefficient_count());
    EXPECT_EQ(map.order(), specification.order());
    const Eigen::MatrixXd x = random_points(70, map.dimension(), 4, 1.5);
    MapBatch readable;
    map.evaluate(x, 1, readable);
    EXPECT_LT(largest_difference(map.evaluate(x), readable.value), 1e-12);
    EXPECT_LT(largest_difference(map.evaluate(map.inverse(readable.value)), readable.value), 1e-10);
  }
}

TEST(TriangularMap, NeighboursOfAPointChangeNoBit) {
  const TriangularMap map = with_random_coefficients(total_order_map(3, 3, k_softplus), 3, 0.1);
  const Eigen::MatrixXd x = random_points(1500, 3, 4, 1.5);
  EXPECT_EQ(map.evaluate(x.middleRows(777, 5)), map.evaluate(x).middleRows(777, 5));
}

TEST(TriangularMap, EmbeddingMatchesIndices) {
  const int orders[] = {3, 1, 2};
  const MapSpecification small = per_variable_map(orders, k_softplus);
  const TriangularMap low = with_random_coefficients(small, 3, 0.2);
  TriangularMap high(total_order_map(3, 4, k_softplus));
  high.embed(low);
  const Eigen::MatrixXd x = random_points(40, 3, 5, 1.5);
  EXPECT_LT(largest_difference(high.evaluate(x), low.evaluate(x)), 1e-12);
  TriangularMap back(small);
  EXPECT_THROW(back.embed(high), UsageError);
  EXPECT_THROW(TriangularMap(3, 4).embed(low), UsageError);
}

TEST(TriangularMap, RefusesSetsThatCannotBe) {
  const auto message = [](std::vector<MultiIndex> constant, std::vector<MultiIndex> monotone) {
    try {
      const TriangularMap map(MapSpecification{
          {}, {{{MultiIndex{}}, {MultiIndex{}}}, {std::move(constant), std::move(monotone)}}});
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  const MultiIndex one{};
  const int own[] = {0, 1}, above[] = {0, 0, 1}, steep[] = {24};
  EXPECT_EQ(message({one}, {one}), "no error");
  EXPECT_EQ(
      message({one, multi_index(own)}, {one}),
      "triangular map, Φ_c of component 1: an index contains variable 1; only those below 1 may be there");
  EXPECT_EQ(
      message({one}, {one, multi_index(above)}),
      "triangular map, Φ_e of component 1: an index contains variable 2; only those below 2 may be there");
  EXPECT_EQ(message({one, multi_index(steep)}, {one}),
            "triangular map, Φ_c of component 1: degree 24 of variable 0; at most 23 is possible");
  EXPECT_EQ(message({one}, {multi_index(own)}),
            "triangular map, Φ_e of component 1: the empty index (the constant 1) is missing");
  EXPECT_EQ(message({one, one}, {one}), "triangular map, Φ_c of component 1: an index occurs twice");
  EXPECT_EQ(
      message({one}, {one, {{{1, 1}, {0, 1}}, 2}}),
      "triangular map, Φ_e of component 1: factors of an index must have increasing variables and degrees "
      "of at least 1");
}

TEST(TriangularMap, DescribesItself) {
  TriangularMap map(total_order_map(2, 2, k_softplus));
  Eigen::VectorXd a = map.coefficients();
  a[map.component(1).offset + 2] = -0.25;  // x_1² in Φ_c
  map.set_coefficients(a);
  EXPECT_EQ(map.describe(),
            "component 1: softplus of Hermite polynomials, linear tails, 1 + 2 terms of degree up to 1; "
            "largest: 0 (1); inside "
            "the integral: 0 (1)\n"
            "component 2: softplus of Hermite polynomials, linear tails, 3 + 3 terms of degree up to 2; "
            "largest: -0.25 (x1^2); "
            "inside the integral: 0 (1)\n");
}

}  // namespace
}  // namespace knothe::posterior
