#include "knothe/numerics/functions/lattice_table.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "knothe/numerics/statistics/random.hpp"

namespace knothe::numerics {
namespace {

struct Counted {
  Index evaluated = 0;
  /// A smooth function, one with a jump along a line, and one with a kink.
  LatticeTable::Functions functions = [this](const Eigen::MatrixXd& p) {
    evaluated += p.rows();
    Eigen::MatrixXd values(p.rows(), 3);
    values.col(0) = (2 * p.col(0)).array().sin() * (p.col(1).array() * 1.5).exp();
    values.col(1) = (p.col(0) + p.col(1)).array() + (p.col(0).array() > 1.03).cast<double>();
    values.col(2) = (p.col(1).array() - 0.98).abs();
    return values;
  };
};

/// `n` normal points about `mean` of correlation 0.9, inside the box.
Eigen::MatrixXd points_near(const Eigen::Vector2d& mean, const Eigen::Vector2d& std, Index n) {
  Eigen::MatrixXd z = monte_carlo_normal_points(n, 2, 3);
  z.col(1) = 0.9 * z.col(0) + std::sqrt(1 - 0.81) * z.col(1);
  return ((z * std.asDiagonal()).rowwise() + mean.transpose()).cwiseMax(0.5).cwiseMin(1.5);
}

LatticeTable table_of(Index count) {
  return {Eigen::Vector2d::Constant(0.5), Eigen::Vector2d::Constant(1.5), count};
}

double std_of(const Eigen::VectorXd& values) {
  return std::sqrt((values.array() - values.mean()).square().mean());
}

TEST(LatticeTable, ErrorsAreBelowAHundredthOfTheStandardDeviation) {
  for (const double width : {0.3, 0.05, 0.004}) {
    for (const double centre : {1.0, 0.5}) {  // the latter at the border
      Counted exact, tabled;
      LatticeTable table = table_of(3);
      const Eigen::MatrixXd points = points_near({centre, 1}, {width, 0.5 * width}, 2000);
      const Eigen::MatrixXd found = table.evaluate(points, Eigen::VectorXd::Ones(2000), tabled.functions);
      const Eigen::MatrixXd wanted = exact.functions(points);
      for (Index k = 0; k < 3; ++k)
        EXPECT_LE((found - wanted).col(k).cwiseAbs().maxCoeff(), 0.01 * std_of(wanted.col(k)))
            << width << " about " << centre << ", function " << k;
    }
  }
}

TEST(LatticeTable, NextPointsNeedFewNewNodesAndTheSameBits) {
  Counted tabled;
  const auto functions = [&](const Eigen::MatrixXd& p) {
    return Eigen::MatrixXd(tabled.functions(p).leftCols(1));  // smooth: nothing is evaluated at points
  };
  LatticeTable table = table_of(1), fresh = table_of(1);
  const Eigen::VectorXd weights = Eigen::VectorXd::Ones(1000);
  const Eigen::MatrixXd next = points_near({1.001, 1.001}, {0.02, 0.02}, 1000);
  (void)table.evaluate(points_near({1, 1}, {0.02, 0.02}, 1000), weights, functions);
  EXPECT_LT(tabled.evaluated, 1000);
  tabled.evaluated = 0;
  const Eigen::MatrixXd found = table.evaluate(next, weights, functions);
  EXPECT_LE(tabled.evaluated, 64);
  EXPECT_EQ(fresh.evaluate(next, weights, functions), found);
}

TEST(LatticeTable, EvaluatesWhereItCannotInterpolate) {
  const auto same = [](const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, const Eigen::MatrixXd& p) {
    Index evaluated = 0;
    const auto first = [&](const Eigen::MatrixXd& at) {
      evaluated += at.rows();
      return Eigen::MatrixXd(at.rowwise().squaredNorm());
    };
    LatticeTable table(lower, upper, 1);
    const Eigen::VectorXd weights = Eigen::VectorXd::Ones(p.rows());
    return table.evaluate(p, weights, first) == first(p) && evaluated == 2 * p.rows();
  };
  const Eigen::Vector2d zero(0, 0), one(1, 1), half(0.5, 0.5);
  constexpr double k_infinity = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(same(Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones(), Eigen::MatrixXd::Random(500, 3)));
  EXPECT_TRUE(same(zero, Eigen::Vector2d(1, k_infinity), points_near(half, {0.1, 0.1}, 500)));
  EXPECT_TRUE(same(zero, one, points_near(half, {0.1, 0.1}, 100)));
  EXPECT_TRUE(same(zero, one, half.transpose().replicate(500, 1)));
}

}  // namespace
}  // namespace knothe::numerics
