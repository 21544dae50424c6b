#include "knothe/model/reduced/spline_functions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "knothe/base/error.hpp"

namespace knothe::model {
namespace {

using Nodes = std::vector<std::vector<double>>;

/// Points inside the box of `nodes`, away from its border by `margin` of its width.
Eigen::MatrixXd points_inside(const Nodes& nodes, Eigen::Index n, double margin, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(margin, 1.0 - margin);
  Eigen::MatrixXd points(n, static_cast<Eigen::Index>(nodes.size()));
  for (Eigen::Index i = 0; i < n; ++i) {
    for (std::size_t a = 0; a < nodes.size(); ++a) {
      points(i, static_cast<Eigen::Index>(a)) =
          nodes[a].front() + uniform(random) * (nodes[a].back() - nodes[a].front());
    }
  }
  return points;
}

FunctionBatch evaluate(const ParameterFunctions& functions, const Eigen::MatrixXd& points, int derivatives) {
  FunctionBatch batch;
  batch.resize(points.rows(), functions.dimension(), functions.count(), derivatives);
  functions.evaluate(points, derivatives, batch);
  return batch;
}

std::vector<double> random_values(std::size_t n, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> values(n);
  for (double& value : values) value = normal(random);
  return values;
}

/// A polynomial of degree ≤ 3 in each variable, different for every k, with its derivatives by hand.
double cubic(int k, double x, int order) {
  const double a = 0.3 + 0.1 * k, b = -0.7 + 0.05 * k, c = 0.2 * k, e = 1.1 - 0.02 * k;
  if (order == 0) return a + x * (b + x * (c + x * e));
  if (order == 1) return b + x * (2 * c + x * 3 * e);
  return 2 * c + 6 * e * x;
}

const Nodes k_three_axes = {
    {0.5, 0.7, 0.8, 1.1, 1.5}, {-1.0, 0.0, 0.4, 2.0}, {0.0, 1.0, 2.0, 3.0, 4.0, 5.5, 6.0}};

/// Values, gradient, Hessian of Π_i cubic(k + i, p_i) against the formula: splines reproduce cubics exactly.
void expect_product_of_cubics(const ParameterFunctions& functions, const Nodes& nodes) {
  const Eigen::MatrixXd points = points_inside(nodes, 40, 0.0, 3);
  const FunctionBatch batch = evaluate(functions, points, 2);
  const auto d = static_cast<std::size_t>(functions.dimension());
  const auto product = [&](Eigen::Index row, int k, std::size_t a, std::size_t b) {
    double result = 1.0;
    for (std::size_t i = 0; i < d; ++i) {
      result *=
          cubic(k + static_cast<int>(i), points(row, static_cast<Eigen::Index>(i)), (a == i) + (b == i));
    }
    return result;
  };
  for (Eigen::Index row = 0; row < points.rows(); ++row) {
    for (int k = 0; k < functions.count(); ++k) {
      const double tolerance = 1e-10 * (1.0 + 1e3);
      ASSERT_NEAR(batch.value(row, k), product(row, k, d, d), tolerance);
      for (std::size_t a = 0; a < d; ++a) {
        ASSERT_NEAR(batch.first[a](row, k), product(row, k, a, d), tolerance);
        for (std::size_t b = 0; b <= a; ++b) {
          ASSERT_NEAR(batch.second[a * (a + 1) / 2 + b](row, k), product(row, k, a, b), tolerance);
        }
      }
    }
  }
}

CanonicalFunctions canonical_cubics(const Nodes& nodes, int r) {
  std::vector<std::vector<double>> values(nodes.size());
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    for (int k = 0; k < r; ++k) {
      for (const double x : nodes[i]) values[i].push_back(cubic(k + static_cast<int>(i), x, 0));
    }
  }
  return CanonicalFunctions(nodes, values, r);
}

JointFunctions joint_cubics(const Nodes& nodes, int r) {
  std::vector<double> values;
  for (int k = 0; k < r; ++k) {
    std::vector<double> product{1.0};
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      std::vector<double> next;
      for (const double factor : product) {
        for (const double x : nodes[i]) next.push_back(factor * cubic(k + static_cast<int>(i), x, 0));
      }
      product = next;
    }
    values.insert(values.end(), product.begin(), product.end());
  }
  return JointFunctions(nodes, values, r);
}

TEST(SplineFunctions, ProductsOfCubicsAreReproducedExactly) {
  for (const int r : {1, 8, 11}) {
    expect_product_of_cubics(canonical_cubics(k_three_axes, r), k_three_axes);
    expect_product_of_cubics(joint_cubics(k_three_axes, r), k_three_axes);
  }
  const Nodes one{k_three_axes[0]};
  expect_product_of_cubics(canonical_cubics(one, 3), one);
  expect_product_of_cubics(joint_cubics(one, 3), one);
  const Nodes four{k_three_axes[0], k_three_axes[1], k_three_axes[1], k_three_axes[0]};
  expect_product_of_cubics(joint_cubics(four, 2), four);
}

TEST(SplineFunctions, ShortAxesAreLineAndParabola) {
  const Nodes nodes{{0.0, 2.0}, {0.0, 1.0, 4.0}};
  std::vector<double> values;  // (1 + 2x)(3 − y + y²)
  for (const double x : nodes[0]) {
    for (const double y : nodes[1]) values.push_back((1 + 2 * x) * (3 - y + y * y));
  }
  const JointFunctions joint(nodes, values, 1);
  const CanonicalFunctions canonical(nodes, std::vector<std::vector<double>>{{1, 5}, {3, 3, 15}}, 1);
  const Eigen::MatrixXd points = points_inside(nodes, 20, 0.0, 9);
  for (const ParameterFunctions* functions :
       {static_cast<const ParameterFunctions*>(&joint), static_cast<const ParameterFunctions*>(&canonical)}) {
    const FunctionBatch batch = evaluate(*functions, points, 2);
    for (Eigen::Index i = 0; i < points.rows(); ++i) {
      const double x = points(i, 0), y = points(i, 1);
      EXPECT_NEAR(batch.value(i, 0), (1 + 2 * x) * (3 - y + y * y), 1e-12);
      EXPECT_NEAR(batch.first[0](i, 0), 2 * (3 - y + y * y), 1e-12);
      EXPECT_NEAR(batch.first[1](i, 0), (1 + 2 * x) * (2 * y - 1), 1e-12);
      EXPECT_NEAR(batch.second[0](i, 0), 0.0, 1e-12);
      EXPECT_NEAR(batch.second[1](i, 0), 2 * (2 * y - 1), 1e-12);
      EXPECT_NEAR(batch.second[2](i, 0), (1 + 2 * x) * 2, 1e-12);
    }
  }
}

/// Central differences of the values against the derivatives.
void expect_derivatives_by_differences(const ParameterFunctions& functions, const Nodes& nodes) {
  const Eigen::MatrixXd points = points_inside(nodes, 30, 0.05, 5);
  const FunctionBatch at = evaluate(functions, points, 2);
  const double h = 1e-5;
  for (Eigen::Index a = 0; a < functions.dimension(); ++a) {
    Eigen::MatrixXd left = points, right = points;
    left.col(a).array() -= h;
    right.col(a).array() += h;
    const FunctionBatch low = evaluate(functions, left, 1), high = evaluate(functions, right, 1);
    const auto size = static_cast<std::size_t>(a);
    EXPECT_LT(((high.value - low.value) / (2 * h) - at.first[size]).cwiseAbs().maxCoeff(), 1e-5);
    for (Eigen::Index b = 0; b < functions.dimension(); ++b) {
      const auto i = static_cast<std::size_t>(std::max(a, b)), j = static_cast<std::size_t>(std::min(a, b));
      const RowMatrix difference =
          (high.first[static_cast<std::size_t>(b)] - low.first[static_cast<std::size_t>(b)]) / (2 * h);
      // A node within h of a point leaves an error of order h × third derivative.
      EXPECT_LT((difference - at.second[i * (i + 1) / 2 + j]).cwiseAbs().maxCoeff(), 2e-2);
    }
  }
}

TEST(SplineFunctions, DerivativesAgreeWithFiniteDifferences) {
  const Nodes nodes{{0.5, 0.7, 0.9, 1.1, 1.3, 1.5}, {0.5, 0.8, 1.0, 1.2, 1.5}};
  expect_derivatives_by_differences(JointFunctions(nodes, random_values(10 * 30, 1), 10), nodes);
  const std::vector<std::vector<double>> values{random_values(60, 2), random_values(50, 3)};
  expect_derivatives_by_differences(CanonicalFunctions(nodes, values, 10), nodes);
}

TEST(SplineFunctions, InterpolatesTheGridAndEachOrderGivesTheSameNumbers) {
  const std::vector<double> values = random_values(5 * 4 * 7 * 3, 4);
  const JointFunctions functions(k_three_axes, values, 3);
  Eigen::MatrixXd points(5 * 4 * 7, 3);
  Eigen::Index row = 0;
  for (const double x : k_three_axes[0]) {
    for (const double y : k_three_axes[1]) {
      for (const double z : k_three_axes[2]) points.row(row++) << x, y, z;
    }
  }
  const FunctionBatch all = evaluate(functions, points, 2);
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    for (Eigen::Index k = 0; k < 3; ++k) {
      EXPECT_NEAR(all.value(i, k), values[static_cast<std::size_t>(k * points.rows() + i)], 1e-12);
    }
  }
  EXPECT_EQ(evaluate(functions, points, 0).value, all.value);
  EXPECT_EQ(evaluate(functions, points, 1).first[2], all.first[2]);
}

TEST(SplineFunctions, BoxAndRoundingOutsideIt) {
  const JointFunctions functions = joint_cubics(k_three_axes, 2);
  EXPECT_EQ(functions.lower(), Eigen::Vector3d(0.5, -1.0, 0.0));
  EXPECT_EQ(functions.upper(), Eigen::Vector3d(1.5, 2.0, 6.0));
  const Eigen::MatrixXd corner = functions.upper().transpose();
  Eigen::MatrixXd outside = corner;
  outside.array() += 1e-14;
  EXPECT_EQ(evaluate(functions, outside, 0).value, evaluate(functions, corner, 0).value);
}

TEST(SplineFunctions, TooManyParametersForOneGrid) {
  const Nodes nodes(9, {0.0, 1.0});
  EXPECT_THROW(JointFunctions(nodes, std::vector<double>(512, 1.0), 1), DataError);
}

}  // namespace
}  // namespace knothe::model
