#include "knothe/numerics/integrate/smolyak.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::numerics {
namespace {

/// E x^e for x ~ N(0, 1).
double moment(int e) {
  if (e % 2 == 1) return 0;
  double value = 1;
  for (int k = e - 1; k > 1; k -= 2) value *= k;
  return value;
}

/// Calls visit(exponents) for all exponents of total degree ≤ degree in d variables.
template <class Visit>
void for_all_monomials(Eigen::Index d, int degree, const Visit& visit) {
  std::vector<int> exponents(static_cast<std::size_t>(d), 0);
  const auto go = [&](const auto& self, std::size_t at, int left) -> void {
    if (at == exponents.size()) {
      visit(exponents);
      return;
    }
    for (int e = 0; e <= left; ++e) {
      exponents[at] = e;
      self(self, at + 1, left - e);
    }
    exponents[at] = 0;
  };
  go(go, 0, degree);
}

/// Largest error over all monomials of total degree ≤ degree, relative to √E x^{2e} of each, the size of what
/// is summed.
double worst_error(const PointRule& rule, int degree) {
  const Eigen::Index d = rule.points.cols();
  std::vector<Eigen::MatrixXd> powers;  // of every coordinate
  for (int e = 0; e <= degree; ++e) powers.emplace_back(rule.points.array().pow(e));
  double worst = 0;
  for_all_monomials(d, degree, [&](const std::vector<int>& exponents) {
    Eigen::VectorXd product = rule.weights;
    double exact = 1, size = 1;
    for (Eigen::Index k = 0; k < d; ++k) {
      const int e = exponents[static_cast<std::size_t>(k)];
      if (e == 0) continue;
      product.array() *= powers[static_cast<std::size_t>(e)].col(k).array();
      exact *= moment(e);
      size *= std::sqrt(moment(2 * e));
    }
    worst = std::max(worst, std::abs(product.sum() - exact) / size);
  });
  return worst;
}

TEST(Smolyak, IsExactToTotalDegreeTwoLevelPlusOne) {
  const int highest_level[11] = {0, 7, 7, 6, 5, 4, 3, 3, 2, 2, 2};
  for (Eigen::Index d = 1; d <= 10; ++d)
    for (int level = 0; level <= highest_level[d]; ++level) {
      const PointRule rule = smolyak_rule(d, level);
      EXPECT_LT(worst_error(rule, 2 * level + 1), 1e-11) << "d " << d << ", level " << level;
    }
}

TEST(Smolyak, IsNotExactBeyond) {
  // Level 1 has no point off the axes, hence E x²y² = 0 instead of 1; degree 4 = 2·1 + 2.
  const PointRule rule = smolyak_rule(2, 1);
  EXPECT_NEAR((rule.weights.array() * rule.points.array().square().rowwise().prod()).sum(), 0, 1e-14);
  EXPECT_GT(worst_error(smolyak_rule(5, 3), 8), 0.01);
}

TEST(Smolyak, HasFewPointsAndWeightsOfBothSigns) {
  for (Eigen::Index d : {2, 5, 10, 50}) {
    EXPECT_EQ(smolyak_rule(d, 0).points.rows(), 1);
    EXPECT_EQ(smolyak_rule(d, 1).points.rows(), 2 * d + 1);
    EXPECT_EQ(smolyak_rule(d, 2).points.rows(), 2 * d * d + 1);
  }
  const PointRule rule = smolyak_rule(10, 2);
  EXPECT_LT(rule.weights.minCoeff(), 0);
  EXPECT_NEAR(rule.weights.sum(), 1, 1e-13);
  EXPECT_GT(rule.weights.cwiseAbs().sum(), 1.5);
}

TEST(Smolyak, ConvergesOnASmoothFunction) {
  // E exp(Σ a_k x_k) = exp(|a|²/2).
  const Eigen::Index d = 6;
  const Eigen::VectorXd a = Eigen::VectorXd::LinSpaced(d, 0.1, 0.35);
  const double exact = std::exp(0.5 * a.squaredNorm());
  double previous = 1;
  for (int level = 1; level <= 5; ++level) {
    const PointRule rule = smolyak_rule(d, level);
    const double error = std::abs((rule.weights.array() * (rule.points * a).array().exp()).sum() / exact - 1);
    EXPECT_LT(error, 0.3 * previous) << level;
    previous = error;
  }
  EXPECT_LT(previous, 1e-6);
}

TEST(Smolyak, RefusesWhatMakesNoSense) {
  EXPECT_THROW((void)smolyak_rule(0, 1), UsageError);
  EXPECT_THROW((void)smolyak_rule(2, -1), UsageError);
  try {
    (void)smolyak_rule(30, 6);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(),
                testing::HasSubstr("Smolyak rule of level 6 in 30 dimensions: 4.68e+07 points"));
  }
}

}  // namespace
}  // namespace knothe::numerics
