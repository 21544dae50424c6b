#include "knothe/posterior/weighted_sample.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/posterior/random_numbers.hpp"

namespace knothe::posterior {
namespace {

TEST(WeightedSample, MomentsByHand) {
  WeightedSample sample;
  sample.points = (Eigen::MatrixXd(3, 2) << 0, 0, 2, 0, 0, 4).finished();
  sample.weights = Eigen::Vector3d(0.5, 0.25, 0.25);
  EXPECT_EQ(mean_of(sample), Eigen::Vector2d(0.5, 1));
  const Eigen::Matrix2d expected = (Eigen::Matrix2d() << 0.75, -0.5, -0.5, 3).finished();
  EXPECT_LT((covariance_of(sample) - expected).cwiseAbs().maxCoeff(), 1e-15);
  sample.weights *= 7;  // only ratios matter
  EXPECT_LT((covariance_of(sample) - expected).cwiseAbs().maxCoeff(), 1e-14);
}

TEST(WeightedSample, BadWeightsAreRefused) {
  WeightedSample sample;
  const auto message = [&] {
    try {
      (void)mean_of(sample);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message(), "weighted sample: 0 points and 0 weights; there must be as many, and some");
  sample.points = Eigen::MatrixXd::Zero(2, 1);
  sample.weights = Eigen::Vector2d(1, -0.5);
  EXPECT_EQ(message(), "weighted sample: weights must be non-negative, with a positive sum");
  sample.weights.setZero();
  EXPECT_THROW((void)covariance_of(sample), UsageError);
}

TEST(WeightedSample, ThinningKeepsHeavyPointsAndChangesNoExpectationOnAverage) {
  const Eigen::Index n = 500, kept = 60;
  Eigen::MatrixXd points(n, 1);
  Eigen::VectorXd weights(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    points(i, 0) = std::sin(static_cast<double>(i));
    weights[i] = i < 3 ? 100 : 0.1 + static_cast<double>(i % 7);
  }
  weights /= weights.sum();
  const double mean = points.col(0).dot(weights);
  double sum = 0;
  constexpr int k_seeds = 400;
  for (int seed = 1; seed <= k_seeds; ++seed) {
    Eigen::MatrixXd p = points;
    Eigen::VectorXd w = weights;
    thin(p, w, kept, static_cast<std::uint64_t>(seed));
    ASSERT_LE(w.size(), kept + 1);
    ASSERT_GE(w.size(), kept - 1);
    EXPECT_NEAR(w.sum(), 1, 1e-12);
    for (Eigen::Index i = 0; i < 3; ++i) {
      EXPECT_EQ(p(i, 0), points(i, 0));
      EXPECT_NEAR(w[i], weights[i], 0.02 * weights[i]);
    }
    for (Eigen::Index i = 1; i < p.rows(); ++i) EXPECT_NE(p(i, 0), p(i - 1, 0));
    sum += p.col(0).dot(w);
  }
  EXPECT_NEAR(sum / k_seeds, mean, 0.01);
}

TEST(WeightedSample, PointsAlongACurveAreSpreadEvenly) {
  // Every 16th of points of a square along the curve: their mean is far nearer that of all than 64 random
  // ones.
  RandomNumbers random(4);
  Eigen::MatrixXd points(1024, 2);
  for (Eigen::Index i = 0; i < points.rows(); ++i) points.row(i) << random.uniform(), random.uniform();
  Eigen::VectorXd weights = Eigen::VectorXd::Constant(1024, 1.0 / 1024);
  weights[7] = 0;
  const Eigen::RowVectorXd heavy = points.row(7), mean = points.colwise().mean();
  sort_along_curve(points, weights);
  EXPECT_LT((points.colwise().mean() - mean).norm(), 1e-12);
  Eigen::Index at = 0;
  weights.minCoeff(&at);
  EXPECT_EQ(points.row(at), heavy) << "weights go with their points";
  const Eigen::MatrixXd some = points(Eigen::seqN(8, 64, 16), Eigen::all);
  const Eigen::RowVectorXd of_some = some.colwise().mean();
  EXPECT_LT((of_some - mean).norm(), 0.25 * std::sqrt(2.0 / 12 / 64));
}

}  // namespace
}  // namespace knothe::posterior
