#include "knothe/posterior/map/triangular_map.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <cmath>
#include <functional>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/hermite.hpp"
#include "knothe/numerics/integrate/quadrature.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/map/composed_map.hpp"

namespace knothe::posterior {
namespace {

TriangularMap random_map(Eigen::Index d, int order, unsigned seed, double size = 0.15) {
  TriangularMap map(d, order);
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  Eigen::VectorXd a = map.coefficients();
  for (auto& x : a) x += size * normal(generator);
  map.set_coefficients(a);
  return map;
}

Eigen::MatrixXd random_points(Eigen::Index n, Eigen::Index d, unsigned seed, double scale = 1.5) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal(0, scale);
  return Eigen::MatrixXd::NullaryExpr(n, d, [&] { return normal(generator); });
}

TEST(MultiIndex, CountsAndNesting) {
  EXPECT_EQ(total_order_indices(0, 5).size(), 1u);
  for (int v : {1, 2, 3, 5})
    for (int p : {0, 1, 3, 4}) {
      const auto set = total_order_indices(v, p), larger = total_order_indices(v, p + 1);
      std::size_t count = 1;  // (v + p)!/(v! p!)
      for (std::size_t k = 1; k <= static_cast<std::size_t>(v); ++k)
        count = count * (static_cast<std::size_t>(p) + k) / k;
      EXPECT_EQ(set.size(), count);
      for (std::size_t i = 0; i < set.size(); ++i) {
        int sum = 0;
        for (const auto& f : set[i].factors) sum += f.degree;
        EXPECT_EQ(sum, set[i].total);
        EXPECT_EQ(set[i].factors.size(),
                  larger[i].factors.size());  // a lower order is the beginning of a higher one
      }
    }
}

TEST(TailedHermite, BothContinuationsAreContinuouslyDifferentiable) {
  const TailedHermite basis;
  TailedHermite::Values v{}, f{}, s{}, v2{}, f2{}, s2{};
  const auto& r = basis.radii();
  for (double kink :
       {-r.tangent, r.tangent, -r.level, r.level, r.level + 2 * r.bend, -r.level - 2 * r.bend, 0.3})
    for (bool level : {false, true}) {
      const double e = 1e-7;
      if (level)
        basis.level(kink - e, 6, v, f, s), basis.level(kink + e, 6, v2, f2, s2);
      else
        basis.tangent(kink - e, 6, v, f, s), basis.tangent(kink + e, 6, v2, f2, s2);
      for (std::size_t j = 0; j <= 6; ++j) {
        const double scale = 1 + std::abs(f[j]) + std::abs(s[j]) + std::abs(s2[j]);
        EXPECT_NEAR(v2[j] - v[j], 2 * e * f[j], 1e-12 * scale);
        EXPECT_NEAR(f2[j], f[j], 1e-6 * scale);
      }
    }
  basis.level(50, 6, v, f, s);
  basis.level(5, 6, v2, f2, s2);
  for (std::size_t j = 0; j <= 6; ++j) EXPECT_EQ(v[j], v2[j]);
  basis.tangent(50, 6, v, f, s);
  basis.tangent(49, 6, v2, f2, s2);
  for (std::size_t j = 0; j <= 6; ++j) EXPECT_NEAR(v[j] - v2[j], f[j], 1e-9);
}

TEST(TailedHermite, ProductIntegralsAgainstNumericalQuadrature) {
  const TailedHermite basis;
  const int n = 7;
  std::vector<double> packed(static_cast<std::size_t>((n + 1) * (n + 2) / 2));
  TailedHermite::Values v{}, f{}, s{};
  for (double x : {-9.0, -3.1, -2.0, -0.1, 0.0, 0.7, 2.5, 2.9, 3.4, 6.0}) {
    basis.product_integrals(x, n, packed);
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(packed.size()));
    const int pieces = 900;  // the composite rule does not know where the kinks are
    for (int piece = 0; piece < pieces; ++piece) {
      const auto rule = numerics::gauss_legendre(4, x * piece / pieces, x * (piece + 1) / pieces);
      for (Eigen::Index q = 0; q < 4; ++q) {
        basis.level(rule.nodes[q], n, v, f, s);
        for (Eigen::Index i = 0; i <= n; ++i)
          for (Eigen::Index j = 0; j <= i; ++j)
            sum[packed_index(i, j)] +=
                rule.weights[q] * v[static_cast<std::size_t>(i)] * v[static_cast<std::size_t>(j)];
      }
    }
    for (Eigen::Index m = 0; m < sum.size(); ++m)
      EXPECT_NEAR(packed[static_cast<std::size_t>(m)], sum[m], 1e-8 * (1 + std::abs(sum[m]))) << x;
  }
}

TEST(TriangularMap, StartsAsTheIdentityAndSaysWhatIsWrong) {
  const TriangularMap map(3, 4);
  const Eigen::MatrixXd x = random_points(20, 3, 1, 4);
  EXPECT_LT((map.evaluate(x) - x).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_LT(map.log_determinant(x).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_THROW(TriangularMap(0, 2), UsageError);
  EXPECT_THROW(TriangularMap(2, 0), UsageError);
  TriangularMap other(2, 2);
  try {
    other.set_coefficients(Eigen::VectorXd::Zero(3));
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("3 coefficients given, the map has"), std::string::npos);
  }
}

TEST(TriangularMap, EquationSevenByIndependentQuadrature) {
  const TriangularMap map = random_map(2, 3, 5);
  const auto& c = map.component(1);
  const double x1 = 0.8, x2 = -1.3;
  // M² = Φ_c(x₁) a_c + ∫₀^{x₂} (Φ_e(x₁, θ) a_e)² dθ with the polynomials written out, inside the radii.
  const auto h = [&](int degree, double x) {
    std::vector<double> v(static_cast<std::size_t>(degree) + 1);
    numerics::normalised_hermite(x, v);
    return v.back();
  };
  double expected = 0;
  for (Eigen::Index m = 0; m < c.constant_count(); ++m)
    expected +=
        map.coefficients()[c.offset + m] * h(c.constant[static_cast<std::size_t>(m)].degree_of(0), x1);
  const auto rule = numerics::gauss_legendre(30, 0, x2);
  for (Eigen::Index q = 0; q < 30; ++q) {
    double slope = 0;
    for (Eigen::Index m = 0; m < c.monotone_count(); ++m) {
      const auto& index = c.monotone[static_cast<std::size_t>(m)];
      slope += map.coefficients()[c.offset + c.constant_count() + m] * h(index.degree_of(0), x1) *
               h(index.degree_of(1), rule.nodes[q]);
    }
    expected += rule.weights[q] * slope * slope;
  }
  EXPECT_NEAR(map.evaluate(Eigen::RowVector2d(x1, x2))(0, 1), expected, 1e-12);
}

void check_input_derivatives(const std::function<void(const Eigen::MatrixXd&, int, MapBatch&)>& map,
                             Eigen::Index d) {
  const Eigen::MatrixXd x = random_points(15, d, 9, 1.8);
  const double e = 1e-5;
  MapBatch at, up, down;
  map(x, 2, at);
  const Eigen::Index packed = d * (d + 1) / 2;
  for (Eigen::Index a = 0; a < d; ++a) {
    Eigen::MatrixXd shifted = x;
    shifted.col(a).array() += e;
    map(shifted, 1, up);
    shifted.col(a).array() -= 2 * e;
    map(shifted, 1, down);
    for (Eigen::Index i = 0; i < d; ++i) {
      const Eigen::VectorXd first = (up.value.col(i) - down.value.col(i)) / (2 * e);
      EXPECT_LT((at.jacobian.col(i * d + a) - first).cwiseAbs().maxCoeff(),
                2e-7 * (1 + first.cwiseAbs().maxCoeff()));
      for (Eigen::Index b = 0; b < d; ++b) {
        const Eigen::VectorXd second = (up.jacobian.col(i * d + b) - down.jacobian.col(i * d + b)) / (2 * e);
        EXPECT_LT((at.hessian.col(i * packed + packed_index(a, b)) - second).cwiseAbs().maxCoeff(),
                  2e-6 * (1 + second.cwiseAbs().maxCoeff()));
      }
    }
  }
  Eigen::VectorXd determinant(x.rows());
  for (Eigen::Index n = 0; n < x.rows(); ++n) {
    Eigen::MatrixXd j(d, d);
    for (Eigen::Index i = 0; i < d; ++i)
      for (Eigen::Index a = 0; a < d; ++a) j(i, a) = at.jacobian(n, i * d + a);
    EXPECT_NEAR(std::log(std::abs(j.determinant())), at.log_determinant[n],
                1e-9 * (1 + std::abs(at.log_determinant[n])));
  }
}

TEST(TriangularMap, InputDerivativesAgainstFiniteDifferences) {
  for (Eigen::Index d : {1, 2, 3}) {
    const TriangularMap map = random_map(d, 4, 3);
    check_input_derivatives([&](const Eigen::MatrixXd& x, int k, MapBatch& out) { map.evaluate(x, k, out); },
                            d);
  }
}

TEST(ComposedMap, ChainRuleAndInverse) {
  ComposedMap map(2);
  map.append(AffineMap{Eigen::Vector2d(0.3, -1), (Eigen::Matrix2d() << 0.5, 0, -0.7, 1.4).finished()});
  map.append(random_map(2, 3, 11));
  AffineMap turned{Eigen::Vector2d(0.1, 0.2), Eigen::Matrix2d::Identity()};
  turned.rotation = Eigen::MatrixXd::Constant(2, 2, 0.6);
  turned.rotation(1, 0) = 0.8, turned.rotation(0, 1) = -0.8;
  map.append(turned);
  map.append(random_map(2, 2, 12));
  check_input_derivatives([&](const Eigen::MatrixXd& x, int k, MapBatch& out) { map.evaluate(x, k, out); },
                          2);
  const Eigen::MatrixXd x = random_points(30, 2, 4);
  EXPECT_LT((map.inverse(map.evaluate(x)) - x).cwiseAbs().maxCoeff(), 1e-10);
  EXPECT_THROW(map.append(TriangularMap(3, 1)), UsageError);
}

TEST(ComposedMap, LogDensityIntegratesToOne) {
  ComposedMap map(1);
  map.append(random_map(1, 4, 21, 0.1));
  double mass = 0;
  const double step = 0.005;
  Eigen::MatrixXd z(8001, 1);
  for (Eigen::Index i = 0; i < z.rows(); ++i) z(i, 0) = -20 + step * static_cast<double>(i);
  mass = map.log_density(z).array().exp().sum() * step;
  EXPECT_NEAR(mass, 1, 1e-6);
}

TEST(TriangularMap, InverseRoundTrip) {
  for (Eigen::Index d : {1, 2, 4})
    for (int order : {1, 3, 6}) {
      const TriangularMap map = random_map(d, order, 31, 0.08);
      Eigen::MatrixXd x = random_points(40, d, 32);
      x.row(0).setConstant(8), x.row(1).setConstant(-8), x.row(2).setZero();
      const Eigen::MatrixXd z = map.evaluate(x), back = map.inverse(z), again = map.evaluate(back);
      for (Eigen::Index i = 0; i < x.rows(); ++i)
        for (Eigen::Index k = 0; k < d; ++k)
          EXPECT_NEAR(again(i, k), z(i, k), 1e-12 * (1 + z.row(i).cwiseAbs().maxCoeff()))
              << d << " " << order;
    }
  // Far from any image of a reasonable point: finite, no crash.
  const TriangularMap map = random_map(2, 5, 33);
  const Eigen::MatrixXd far = map.inverse((Eigen::MatrixXd(2, 2) << 1e6, -1e6, -1e3, 1e5).finished());
  EXPECT_TRUE(far.allFinite());
}

TEST(TriangularMap, EmbeddingKeepsTheMap) {
  const TriangularMap low = random_map(3, 2, 41);
  TriangularMap high(3, 4);
  high.embed(low);
  const Eigen::MatrixXd x = random_points(25, 3, 42, 3);
  EXPECT_LT((high.evaluate(x) - low.evaluate(x)).cwiseAbs().maxCoeff(), 1e-11);
}

}  // namespace
}  // namespace knothe::posterior
