#include "knothe/posterior/draws/polar_scan.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "knothe/posterior/testing/test_mixtures.hpp"

namespace knothe::posterior {
namespace {

using targets::Mixture;

Eigen::MatrixXd covariance(double a, double b, double correlation) {
  return (Eigen::Matrix2d() << a * a, correlation * a * b, correlation * a * b, b * b).finished();
}

TEST(PolarScan, TheEvidenceOfAGaussianAtAnyScale) {
  for (const double correlation : {0.0, 0.9, 0.999}) {
    const Eigen::MatrixXd c = covariance(3e-4, 20, correlation);
    Mixture user({{1, Eigen::Vector2d(1, -2), c.inverse()}});
    CheckedDensity target(user);
    const PolarScan scan(target, Eigen::Vector2d(1, -2), c.llt().matrixL(), 0.1, 300, 0.15);
    EXPECT_NEAR(scan.log_evidence(), 0, 0.01) << correlation;
    EXPECT_TRUE(scan.local_maxima().empty()) << correlation;
    EXPECT_EQ(target.evaluations(), scan.points().rows());
  }
  Mixture line({{1, Eigen::VectorXd::Constant(1, 7), Eigen::MatrixXd::Constant(1, 1, 1e4)}});
  CheckedDensity target(line);
  const PolarScan scan(target, Eigen::VectorXd::Constant(1, 7), Eigen::MatrixXd::Constant(1, 1, 0.01), 0.1,
                       300, 0.03);
  EXPECT_NEAR(scan.log_evidence(), 0, 0.01);
  EXPECT_TRUE(scan.local_maxima().empty());
}

TEST(PolarScan, TheSampleHasTheMomentsOfTheTarget) {
  const Eigen::MatrixXd c = covariance(1, 2, 0.5);
  Mixture user({{1, Eigen::Vector2d(0.4, -0.3), c.inverse()}});
  CheckedDensity target(user);
  const PolarScan scan(target, Eigen::Vector2d::Zero(), Eigen::Matrix2d::Identity(), 0.1, 100, 0.15);
  EXPECT_NEAR(scan.log_evidence(), 0, 0.005);
  const std::vector<Eigen::Index> sample = scan.sample(1000);
  ASSERT_NEAR(static_cast<double>(sample.size()), 1000, 1);
  const Eigen::MatrixXd points = scan.points()(sample, Eigen::all);
  EXPECT_NEAR(points.col(0).mean(), 0.4, 0.05);
  EXPECT_NEAR(points.col(1).mean(), -0.3, 0.1);
  const Eigen::MatrixXd centred = points.rowwise() - points.colwise().mean();
  EXPECT_LT((centred.transpose() * centred / 1000 - c).norm(), 0.2);
}

TEST(PolarScan, AModeAnEighthAsWideHasAPointInItsBasin) {
  RandomNumbers random(4);
  for (int trial = 0; trial < 200; ++trial) {
    const Eigen::Index d = 1 + trial % 2;
    const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(d, d);
    const Eigen::VectorXd other =
        std::pow(10.0, 1 + 1.3 * random.uniform()) * random.normals(d, 1).col(0).normalized();
    Mixture user({{0.98, Eigen::VectorXd::Zero(d), unit}, {0.02, other, 64 * unit}});
    CheckedDensity target(user);
    const PolarScan scan(target, Eigen::VectorXd::Zero(d), unit, 0.5, 300, d == 1 ? 0.03 : 0.15);
    const std::vector<Eigen::Index> maxima = scan.local_maxima();
    ASSERT_FALSE(maxima.empty()) << trial;
    const bool near = std::any_of(maxima.begin(), maxima.end(), [&](Eigen::Index i) {
      return (scan.points().row(i).transpose() - other).norm() < 0.1 * other.norm();
    });
    EXPECT_TRUE(near) << trial;
  }
}

}  // namespace
}  // namespace knothe::posterior
