#include "knothe/sampling/weighted_sample.hpp"

#include <gtest/gtest.h>

#include <string>

#include "knothe/base/error.hpp"

namespace knothe::sampling {
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

}  // namespace
}  // namespace knothe::sampling
