#include "knothe/assimilation/verdict/parameter_change.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <random>

#include "knothe/numerics/statistics/chi_squared.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index k_functions = 4, k_values = 10;

/// Linear data d = A_t w + noise of N(0, 1), w(p) = w₀ + B p.
struct LinearTest {
  std::vector<MatrixXd> maps;    // A_t, n × r
  std::vector<VectorXd> values;  // d_t

  LinearTest(std::size_t steps, std::size_t changed_before, const VectorXd& change, unsigned seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    const auto draws = [&](Index rows, Index columns) {
      return MatrixXd(MatrixXd::NullaryExpr(rows, columns, [&](Index, Index) { return normal(random); }));
    };
    for (std::size_t t = 0; t < steps; ++t) {
      maps.push_back(draws(k_values, k_functions));
      const VectorXd p = VectorXd::Constant(2, 0.3) + (t < changed_before ? VectorXd::Zero(2) : change);
      values.emplace_back(maps.back() * (slope() * p) + draws(k_values, 1));
    }
  }
  static MatrixXd slope() {
    MatrixXd slope(k_functions, 2);
    slope << 1, 0, 0, 1, 0.5, -0.5, 0.2, 0.4;
    return slope;
  }
  /// The normal equations of p for steps [from, to).
  [[nodiscard]] std::pair<MatrixXd, VectorXd> equations(std::size_t from, std::size_t to) const {
    MatrixXd a = MatrixXd::Zero(2, 2);
    VectorXd b = VectorXd::Zero(2);
    for (std::size_t t = from; t < to; ++t) {
      const MatrixXd rows = maps[t] * slope();
      a += rows.transpose() * rows;
      b += rows.transpose() * values[t];
    }
    return {a, b};
  }
  [[nodiscard]] likelihood::FormBlocks blocks() const {
    likelihood::FormBlocks blocks;
    for (std::size_t t = 0; t < maps.size(); ++t) {
      likelihood::StepForm form = likelihood::StepForm::zero(k_functions);
      form.quadratic = maps[t].transpose() * maps[t];
      form.linear = maps[t].transpose() * values[t];
      blocks.add(form);
    }
    return blocks;
  }
  /// At the posterior of a flat prior.
  [[nodiscard]] ParameterChange found() const {
    const auto [a, b] = equations(0, maps.size());
    const Eigen::LLT<MatrixXd> factor(a);
    const MatrixXd std = factor.matrixU().solve(MatrixXd::Identity(2, 2));
    return find_parameter_change(blocks(), slope() * factor.solve(b), slope() * std, 1);
  }
};

TEST(FormBlocks, HoldEveryStepOnceInBlocksOfEquallyMany) {
  for (const int steps : {1, 15, 16, 17, 33, 100, 1000}) {
    likelihood::FormBlocks blocks;
    double sum = 0;
    for (int t = 1; t <= steps; ++t) {
      likelihood::StepForm form = likelihood::StepForm::zero(1);
      form.constant = t;
      form.used = 1;
      blocks.add(form);
    }
    for (std::size_t k = 0; k < blocks.forms().size(); ++k) {
      sum += blocks.forms()[k].constant;
      const auto used = static_cast<std::size_t>(blocks.forms()[k].used);
      if (k + 1 < blocks.forms().size()) EXPECT_EQ(used, blocks.steps_per_block());
      EXPECT_LE(used, blocks.steps_per_block());
    }
    EXPECT_EQ(sum, steps * (steps + 1) / 2);
    EXPECT_LE(blocks.forms().size(), likelihood::FormBlocks::k_max_blocks);
    if (steps > 15) EXPECT_GE(blocks.forms().size(), k_min_blocks);
  }
}

/// The square of the score test is that of the difference of the two parts' least-squares estimates in the
/// metric of its covariance: Wald's and the score test agree for linear data.
TEST(ParameterChange, IsTheDifferenceOfTheTwoPartsEstimates) {
  const LinearTest test(16, 8, VectorXd::Constant(2, 0.5), 3);
  double largest = 0;
  std::size_t at = 0;
  for (std::size_t k = 1; k < 16; ++k) {
    const auto [a, b] = test.equations(0, k);
    const auto [c, d] = test.equations(k, 16);
    const VectorXd difference = a.llt().solve(b) - c.llt().solve(d);
    const MatrixXd covariance =
        a.llt().solve(MatrixXd::Identity(2, 2)) + c.llt().solve(MatrixXd::Identity(2, 2));
    const double x = difference.dot(covariance.llt().solve(difference));
    if (x > largest) largest = x, at = k;
  }
  const ParameterChange found = test.found();
  EXPECT_EQ(found.after, at);
  // A part that says little is asked for a little more.
  const double exact = 15 * numerics::chi_squared_upper(largest, 2);
  EXPECT_GE(found.probability, exact);
  EXPECT_LE(found.probability, 1.3 * exact);
}

TEST(ParameterChange, IsFoundWhereItWas) {
  for (const std::size_t before : {24, 48, 72}) {
    const ParameterChange found = LinearTest(96, before, VectorXd::Constant(2, 0.5), 5).found();
    EXPECT_LT(found.probability, 1e-8);
    EXPECT_NEAR(static_cast<double>(found.after), static_cast<double>(before), 8);
  }
}

TEST(ParameterChange, IsAsRareAsItSaysWhereThereIsNone) {
  int below = 0;
  constexpr int k_runs = 2000;
  for (unsigned k = 0; k < k_runs; ++k)
    if (LinearTest(32, 32, VectorXd::Zero(2), 100 + k).found().probability < 0.05) ++below;
  EXPECT_LE(below, 0.05 * k_runs + 3 * std::sqrt(0.05 * k_runs));
  EXPECT_GE(below, 0.005 * k_runs);  // not so careful that it never speaks
}

/// Of one of the ten values as a series of its own: the estimate without it against the one from it alone.
TEST(PartOfTheData, IsTheDifferenceOfTheEstimatesAndAsRareAsItSays) {
  int below = 0;
  constexpr int k_runs = 1000;
  for (unsigned run = 0; run < k_runs; ++run) {
    const LinearTest test(32, 32, VectorXd::Zero(2), 100 + run);
    const auto [a, b] = test.equations(0, 32);
    MatrixXd c = MatrixXd::Zero(2, 2);
    VectorXd d = VectorXd::Zero(2);
    likelihood::StepForm all = likelihood::StepForm::zero(k_functions), part = all;
    for (std::size_t t = 0; t < 32; ++t) {
      const MatrixXd row = test.maps[t].row(3);
      c += LinearTest::slope().transpose() * row.transpose() * row * LinearTest::slope();
      d += LinearTest::slope().transpose() * row.transpose() * test.values[t][3];
      part.quadratic += row.transpose() * row;
      part.linear += row.transpose() * test.values[t][3];
      all.quadratic += test.maps[t].transpose() * test.maps[t];
      all.linear += test.maps[t].transpose() * test.values[t];
    }
    const Eigen::LLT<MatrixXd> factor(a);
    const VectorXd w = LinearTest::slope() * factor.solve(b);
    const MatrixXd tangent = LinearTest::slope() * MatrixXd(factor.matrixU().solve(MatrixXd::Identity(2, 2)));
    const double found =
        probability_of_part(said_of_parameters(part, w, tangent), said_of_parameters(all, w, tangent), 1);
    const VectorXd difference = c.llt().solve(d) - (a - c).llt().solve(b - d);
    const MatrixXd covariance = c.inverse() + (a - c).inverse();
    const double exact = numerics::chi_squared_upper(difference.dot(covariance.llt().solve(difference)), 2);
    EXPECT_GE(found, exact);
    EXPECT_LE(found, 1.2 * exact + 0.02);
    below += found < 0.05 ? 1 : 0;
  }
  EXPECT_NEAR(below, 0.05 * k_runs, 3.5 * std::sqrt(0.05 * k_runs));
}

TEST(ParameterChange, NeedsAFewBlocks) {
  EXPECT_EQ(LinearTest(7, 3, VectorXd::Constant(2, 5), 1).found().probability, 1);
}

}  // namespace
}  // namespace knothe::assimilation
