#include "knothe/numerics/functions/cubic_spline.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::numerics {
namespace {

const std::vector<double> k_uneven = {-1.0, -0.7, 0.1, 0.35, 1.2, 1.9, 2.0};

template <class F>
std::vector<double> sample(const std::vector<double>& nodes, F f) {
  std::vector<double> values;
  for (double x : nodes) values.push_back(f(x));
  return values;
}

TEST(CubicSpline, ReproducesCubicsWithAllDerivatives) {
  const auto f = [](double x) { return 2 - x + 3 * x * x - 0.5 * x * x * x; };
  const CubicSpline spline(k_uneven, sample(k_uneven, f));
  for (double x = -1.2; x < 2.2; x += 0.037) {
    EXPECT_NEAR(spline.value(x), f(x), 1e-12);
    EXPECT_NEAR(spline.derivative(x), -1 + 6 * x - 1.5 * x * x, 1e-11);
    EXPECT_NEAR(spline.second_derivative(x), 6 - 3 * x, 1e-10);
  }
}

TEST(CubicSpline, TwoNodesAreALineThreeAParabola) {
  const std::vector<double> two = {1.0, 3.0}, three = {0.0, 1.0, 4.0};
  const CubicSpline line(two, std::vector<double>{2.0, -2.0});
  EXPECT_NEAR(line.value(2.5), -1.0, 1e-14);
  EXPECT_NEAR(line.derivative(9.0), -2.0, 1e-14);
  EXPECT_EQ(line.second_derivative(1.0), 0.0);
  const CubicSpline parabola(three, sample(three, [](double x) { return x * x - x + 1; }));
  EXPECT_NEAR(parabola.value(2.0), 3.0, 1e-13);
  EXPECT_NEAR(parabola.derivative(3.0), 5.0, 1e-13);
  EXPECT_NEAR(parabola.second_derivative(0.5), 2.0, 1e-13);
}

TEST(CubicSpline, IsTwiceContinuousAndNotAKnot) {
  const CubicSpline spline(k_uneven, sample(k_uneven, [](double x) { return std::sin(3 * x); }));
  for (double node : k_uneven) {
    const auto below = spline.evaluate(std::nextafter(node, -9.0)), above = spline.evaluate(node);
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(below[k], above[k], 1e-10);
  }
  EXPECT_EQ(spline.pieces().size(), k_uneven.size() - 3);  // no break at the second and the last but one node
}

TEST(CubicSpline, ConvergesWithFourthOrder) {
  double previous = 0;
  for (int n : {9, 17, 33}) {
    std::vector<double> nodes;
    for (int i = 0; i < n; ++i) nodes.push_back(i / (n - 1.0));
    const CubicSpline spline(nodes, sample(nodes, [](double x) { return std::exp(2 * x); }));
    double error = 0;
    for (double x = 0; x <= 1; x += 0.003)
      error = std::max(error, std::abs(spline.value(x) - std::exp(2 * x)));
    if (previous > 0) {
      EXPECT_GT(previous / error, 11.0);
    }
    previous = error;
  }
}

TEST(CubicSplineBasis, AgreesWithTheSplineAndSumsToOne) {
  const auto values = sample(k_uneven, [](double x) { return std::cos(2 * x) + x; });
  const CubicSpline spline(k_uneven, values);
  const CubicSplineBasis basis(k_uneven);
  const Eigen::Map<const Eigen::VectorXd> y(values.data(), basis.size());
  const Eigen::VectorXd c = basis.coefficients_from_values() * y;
  for (double x = -1.1; x < 2.1; x += 0.021) {
    const auto local = basis.evaluate(x);
    ASSERT_LE(local.first + basis.active(), basis.size());
    double sum = 0, s0 = 0, s1 = 0, s2 = 0;
    for (std::size_t f = 0; f < 4; ++f) {
      const double coefficient = c[local.first + static_cast<Eigen::Index>(f)];
      sum += local.value[f];
      s0 += coefficient * local.value[f];
      s1 += coefficient * local.first_derivative[f];
      s2 += coefficient * local.second_derivative[f];
    }
    EXPECT_NEAR(sum, 1.0, 1e-12);
    EXPECT_NEAR(s0, spline.value(x), 1e-12);
    EXPECT_NEAR(s1, spline.derivative(x), 1e-11);
    EXPECT_NEAR(s2, spline.second_derivative(x), 1e-9);
    EXPECT_NEAR(basis.cardinal_weights(x).dot(y), spline.value(x), 1e-12);
    EXPECT_NEAR(basis.cardinal_weights(x, 1).dot(y), spline.derivative(x), 1e-11);
    EXPECT_NEAR(basis.cardinal_weights(x, 2).dot(y), spline.second_derivative(x), 1e-9);
  }
}

TEST(CubicSplineBasis, FewNodes) {
  for (std::size_t n : {2u, 3u, 4u}) {
    const std::vector<double> nodes(k_uneven.begin(), k_uneven.begin() + static_cast<std::ptrdiff_t>(n));
    const CubicSplineBasis basis(nodes);
    for (std::size_t i = 0; i < n; ++i) {
      const Eigen::VectorXd w = basis.cardinal_weights(nodes[i]);
      for (std::size_t j = 0; j < n; ++j)
        EXPECT_NEAR(w[static_cast<Eigen::Index>(j)], i == j ? 1.0 : 0.0, 1e-13);
    }
  }
}

TEST(CubicSpline, SaysWhatIsWrongWithTheNodes) {
  try {
    CubicSplineBasis(std::vector<double>{0.0, 1.0, 1.0});
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("node 2 (1) is not above node 1 (1)"), std::string::npos);
  }
  EXPECT_THROW(CubicSplineBasis(std::vector<double>{0.0}), UsageError);
  EXPECT_THROW(CubicSpline(std::vector<double>{0.0, 1.0}, std::vector<double>{0.0}), UsageError);
  EXPECT_THROW(CubicSpline(std::vector<double>{0.0, 1.0}, std::vector<double>{0.0, NAN}), UsageError);
}

}  // namespace
}  // namespace knothe::numerics
