#include "knothe/numerics/functions/sparse_interpolation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/numerics/functions/degree_growth.hpp"

namespace knothe::numerics {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

std::string message_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

VectorXd vector(std::initializer_list<double> values) {
  return Eigen::Map<const VectorXd>(values.begin(), static_cast<Eigen::Index>(values.size()));
}

/// Σ c p^ν over any exponents.
struct Polynomial {
  std::vector<MultiIndex> exponents;
  std::vector<double> coefficients;
  double operator()(const VectorXd& p) const {
    double sum = 0;
    for (std::size_t n = 0; n < exponents.size(); ++n) {
      double term = coefficients[n];
      for (std::size_t i = 0; i < exponents[n].size(); ++i)
        term *= std::pow(p[static_cast<Eigen::Index>(i)], exponents[n][i]);
      sum += term;
    }
    return sum;
  }
};

/// All indices with ν₀/6 + ν₁/2 + ν₂/3 ≤ 1.
std::vector<MultiIndex> anisotropic_indices() {
  std::vector<MultiIndex> result;
  for (int a = 0; a <= 6; ++a)
    for (int b = 0; b <= 2; ++b)
      for (int c = 0; c <= 3; ++c)
        if (a + 3 * b + 2 * c <= 6) result.push_back({a, b, c});
  return result;
}

MatrixXd values_at_nodes(const SparseInterpolation& interpolation,
                         const std::function<double(const VectorXd&)>& f) {
  MatrixXd values(interpolation.count(), 1);
  for (Eigen::Index n = 0; n < interpolation.count(); ++n)
    values(n, 0) = f(interpolation.node(interpolation.indices()[static_cast<std::size_t>(n)]));
  return values;
}

double largest_error(const SparseInterpolation& interpolation,
                     const std::function<double(const VectorXd&)>& f, const VectorXd& lower,
                     const VectorXd& upper) {
  const MatrixXd surpluses = interpolation.surpluses(values_at_nodes(interpolation, f));
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit;
  double worst = 0;
  for (int trial = 0; trial < 200; ++trial) {
    VectorXd p = lower;
    for (Eigen::Index i = 0; i < p.size(); ++i) p[i] += unit(random) * (upper[i] - lower[i]);
    worst = std::max(worst, std::abs(surpluses.col(0).dot(interpolation.basis(p)) - f(p)));
  }
  return worst;
}

TEST(LejaNodes, MaximiseTheProductOfDistancesToThoseBefore) {
  const std::vector<double> nodes = leja_nodes(20);
  EXPECT_EQ((std::vector<double>{nodes[0], nodes[1], nodes[2]}), (std::vector<double>{0, 1, -1}));
  EXPECT_NEAR(nodes[3], 1 / std::sqrt(3.0), 1e-15);  // of x (x² − 1)
  for (std::size_t n = 3; n < nodes.size(); ++n) {
    const auto product = [&](double x) {
      double result = 1;
      for (std::size_t j = 0; j < n; ++j) result *= std::abs(x - nodes[j]);
      return result;
    };
    double largest = 0;
    for (int k = -10000; k <= 10000; ++k) largest = std::max(largest, product(1e-4 * k));
    EXPECT_GE(product(nodes[n]), largest * (1 - 1e-8)) << n;
  }
}

TEST(SparseInterpolation, MeetsAPolynomialWithAsManyNodesAsItHasCoefficients) {
  const VectorXd lower = vector({0.5, -2, 10}), upper = vector({1.5, 3, 11});
  SparseInterpolation interpolation(lower, upper);
  Polynomial f{anisotropic_indices(), {}};
  for (const MultiIndex& index : f.exponents) {
    interpolation.add(index);
    f.coefficients.push_back(std::sin(1.0 + static_cast<double>(f.coefficients.size())));
  }
  EXPECT_EQ(interpolation.count(), 23);
  EXPECT_LT(largest_error(interpolation, f, lower, upper), 1e-8);  // values up to 1e3
  // A degree that is not there is missed.
  f.exponents.push_back({7, 0, 0});
  f.coefficients.push_back(1);
  EXPECT_GT(largest_error(interpolation, f, lower, upper), 1e-4);
}

TEST(SparseInterpolation, LaterIndicesLeaveTheSurplusesBeforeThem) {
  SparseInterpolation interpolation(vector({-1, -1}), vector({1, 1}));
  const auto f = [](const VectorXd& p) { return std::exp(p[0] * p[1] + p[0]); };
  for (int a = 0; a < 4; ++a) interpolation.add({a, 0});
  const MatrixXd before = interpolation.surpluses(values_at_nodes(interpolation, f));
  for (int a = 0; a < 4; ++a) interpolation.add({a, 1});
  const MatrixXd after = interpolation.surpluses(values_at_nodes(interpolation, f));
  EXPECT_EQ(MatrixXd(after.topRows(4)), before);
  // On the line p₁ = middle it is the interpolation in one variable.
  const VectorXd p = vector({0.3, 0});
  EXPECT_NEAR(after.col(0).dot(interpolation.basis(p)), std::exp(0.3), 0.01);
}

TEST(SparseInterpolation, GradientIsThatOfTheBasis) {
  SparseInterpolation interpolation(vector({0.5, -2, 10}), vector({1.5, 3, 11}));
  for (const MultiIndex& index : anisotropic_indices()) interpolation.add(index);
  const VectorXd p = vector({0.71, 1.3, 10.2});
  const MatrixXd gradient = interpolation.basis_gradient(p);
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double h = 1e-5;
    VectorXd ahead = p, behind = p;
    ahead[i] += h;
    behind[i] -= h;
    const VectorXd difference = (interpolation.basis(ahead) - interpolation.basis(behind)) / (2 * h);
    EXPECT_LT((difference - gradient.col(i)).cwiseAbs().maxCoeff(),
              1e-6 * (1 + gradient.col(i).cwiseAbs().maxCoeff()));
  }
}

TEST(SparseInterpolation, RefusesHolesAndRepetitions) {
  SparseInterpolation interpolation(vector({0, 0}), vector({1, 1}));
  interpolation.add({0, 0});
  EXPECT_EQ(message_of([&] {
              interpolation.add({1, 1});
            }),
            "sparse interpolation: index (1, 1) needs (0, 1) before it");
  EXPECT_EQ(message_of([&] {
              interpolation.add({0, 0});
            }),
            "sparse interpolation: index (0, 0) is there already");
  EXPECT_EQ(message_of([&] { interpolation.add({1}); }),
            "sparse interpolation: (1) is no index of 2 variables");
  EXPECT_EQ(message_of([&] { SparseInterpolation(vector({0}), vector({0})); }),
            "sparse interpolation: the box must be finite, each upper end above its lower one");
}

/// Grows by the size of the surpluses until they are all rounding.
SparseInterpolation grown(const std::function<double(const VectorXd&)>& f, const VectorXd& lower,
                          const VectorXd& upper) {
  SparseInterpolation interpolation(lower, upper);
  DegreeGrowth growth(static_cast<int>(lower.size()), 20);
  while (true) {
    for (auto n = static_cast<std::size_t>(interpolation.count()); n < growth.indices().size(); ++n)
      interpolation.add(growth.indices()[n]);
    const VectorXd s = interpolation.surpluses(values_at_nodes(interpolation, f)).col(0).cwiseAbs();
    double active = 0;
    for (std::size_t n = 0; n < growth.indices().size(); ++n)
      if (growth.is_active(n)) active = std::max(active, s[static_cast<Eigen::Index>(n)]);
    if (active < 1e-9) return interpolation;
    growth.expand({s.data(), static_cast<std::size_t>(s.size())}, false, 1000);
  }
}

TEST(DegreeGrowth, FindsTheDegreesOfAPolynomialAndLittleMore) {
  // Degree 6 in p₀, 1 in p₁, 2 in p₂ and no mixed term but p₀ p₂: 11 coefficients in the smallest set.
  const auto f = [](const VectorXd& p) {
    return std::pow(p[0], 6) + p[1] + p[2] * p[2] + p[0] * p[2] + std::pow(p[0], 5);
  };
  const VectorXd lower = vector({0.2, 0.1, 0.3}), upper = vector({1.2, 1, 1.7});
  const SparseInterpolation interpolation = grown(f, lower, upper);
  EXPECT_LT(largest_error(interpolation, f, lower, upper), 1e-9);
  EXPECT_EQ(interpolation.degree(0), 7);  // the last degree of each tells that it is enough
  EXPECT_EQ(interpolation.degree(1), 2);
  EXPECT_EQ(interpolation.degree(2), 3);
  EXPECT_LE(interpolation.count(), 30);  // the whole grid of these degrees has 7 · 2 · 3 = 42
}

TEST(DegreeGrowth, StaysDownwardClosedWithinItsRoom) {
  DegreeGrowth growth(4, 3);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit;
  std::size_t before = 0;
  while (growth.indices().size() > before && growth.indices().size() < 100) {
    before = growth.indices().size();
    std::vector<double> indicator(before);
    for (double& value : indicator) value = unit(random);
    growth.expand(indicator, false, 7);
    EXPECT_LE(growth.indices().size(), before + 7);
  }
  SparseInterpolation interpolation(VectorXd::Zero(4), VectorXd::Ones(4));
  for (const MultiIndex& index : growth.indices()) EXPECT_NO_THROW(interpolation.add(index));
  for (Eigen::Index i = 0; i < 4; ++i) EXPECT_LE(interpolation.degree(i), 3);
  EXPECT_GE(growth.indices().size(), 100U);
}

TEST(DegreeGrowth, EvenlyIsByTotalDegree) {
  DegreeGrowth growth(3, 5);
  for (const std::size_t count : {1U, 4U, 10U, 20U}) {  // (d + k over k)
    EXPECT_EQ(growth.indices().size(), count);
    growth.expand(std::vector<double>(growth.indices().size(), 0.0), true, 1000);
  }
}

TEST(DegreeGrowth, WhatIsLeftOutDoesNotComeBackNorWhatIsAboveIt) {
  DegreeGrowth growth(2, 4);
  for (int round = 0; round < 6; ++round) {
    growth.expand(std::vector<double>(growth.indices().size(), 0.0), true, 1000);
    for (std::size_t n = growth.indices().size(); n-- > 0;)
      if (growth.indices()[n] == MultiIndex{1, 1}) growth.leave_out(n);
  }
  EXPECT_EQ(growth.indices().size(), 9u);  // the two axes: 0 and 1 to 4 of each
  for (const MultiIndex& index : growth.indices()) EXPECT_TRUE(index[0] == 0 || index[1] == 0);
  EXPECT_THROW(growth.leave_out(0), UsageError);
}

}  // namespace
}  // namespace knothe::numerics
