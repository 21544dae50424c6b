#include "knothe/likelihood/noise/predictive.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <limits>
#include <numbers>

namespace knothe::likelihood {
namespace {

constexpr double k_missing = std::numeric_limits<double>::quiet_NaN();

/// A covariance of four dofs, of which the last is independent of the others.
Eigen::MatrixXd covariance() {
  Eigen::MatrixXd r(4, 4);
  r << 2, 0.6, 0.2, 0, 0.6, 1, -0.3, 0, 0.2, -0.3, 0.5, 0, 0, 0, 0, 3;
  return r;
}

/// log N(x; 0, R), dense.
double log_density(const Eigen::VectorXd& x, const Eigen::MatrixXd& r) {
  return -0.5 * (x.dot(r.inverse() * x) + std::log((2 * std::numbers::pi * r).determinant()));
}

TEST(Predictive, NoiseHasItsCovariance) {
  const GaussianNoise correlated = GaussianNoise::of_covariance(covariance());
  const Eigen::MatrixXd e = noise_draws(correlated, 3, 200000, 1);
  EXPECT_LT((e * e.transpose() / 200000 - covariance().topLeftCorner(3, 3)).cwiseAbs().maxCoeff(), 0.02);
  EXPECT_LT(e.rowwise().mean().norm(), 0.01);
  EXPECT_EQ(e, noise_draws(correlated, 3, 200000, 1));
  const GaussianNoise independent = GaussianNoise::independent(Eigen::Vector2d(0.5, 2));
  const Eigen::MatrixXd f = noise_draws(independent, 2, 200000, 1);
  EXPECT_NEAR(f.row(0).squaredNorm() / 200000, 0.25, 0.003);
  EXPECT_NEAR(f.row(1).squaredNorm() / 200000, 4, 0.05);
}

TEST(Predictive, WhatIsNotMeasuredHasNoDraw) {
  Eigen::SparseMatrix<double> precision(3, 3);
  precision.insert(0, 0) = 4, precision.insert(2, 2) = 1;
  const Eigen::MatrixXd e = noise_draws(GaussianNoise::correlated(precision), 3, 50000, 2);
  EXPECT_TRUE(e.row(1).array().isNaN().all());
  EXPECT_NEAR(e.row(0).squaredNorm() / 50000, 0.25, 0.01);
}

TEST(Predictive, LikelihoodIsTheDenseFormula) {
  const GaussianNoise noise = GaussianNoise::of_covariance(covariance());
  Eigen::MatrixXd predictions(3, 2);
  predictions << 0.1, 0.4, -0.5, 0.2, 0.3, 1.0;
  Eigen::VectorXd values = Eigen::Vector3d(0.7, -0.2, 0.1);
  const Eigen::MatrixXd r = covariance().topLeftCorner(3, 3);
  const Eigen::VectorXd found = log_likelihoods(predictions, values, noise);
  for (int j : {0, 1}) EXPECT_NEAR(found[j], log_density(values - predictions.col(j), r), 1e-12);
  values[1] = k_missing;  // the marginal of the other two
  const Eigen::Matrix2d marginal = r(std::vector<int>{0, 2}, std::vector<int>{0, 2});
  const Eigen::Vector2d rest(values[0] - predictions(0, 1), values[2] - predictions(2, 1));
  EXPECT_NEAR(log_likelihoods(predictions, values, noise)[1], log_density(rest, marginal), 1e-12);
  values.setConstant(k_missing);
  EXPECT_EQ(log_likelihoods(predictions, values, noise)[0], 0);
}

TEST(Predictive, EachValueGivenTheOthersIsTheRatioOfTwoDensities) {
  const GaussianNoise noise = GaussianNoise::of_covariance(covariance());
  Eigen::MatrixXd predictions(4, 2);
  predictions << 0.1, 0.4, -0.5, 0.2, 0.3, 1.0, 2.0, -1.0;
  const Eigen::Vector4d values(0.7, -0.2, 0.1, 0.5);
  ASSERT_TRUE(can_be_split(values, noise));
  const Eigen::MatrixXd found = pointwise_log_likelihoods(predictions, values, noise);
  for (int i = 0; i < 4; ++i) {
    std::vector<int> others;
    for (int k = 0; k < 4; ++k)
      if (k != i) others.push_back(k);
    for (const int j : {0, 1}) {
      const Eigen::VectorXd r = values - predictions.col(j);
      EXPECT_NEAR(found(i, j),
                  log_density(r, covariance()) - log_density(r(others), covariance()(others, others)), 1e-12);
    }
  }
}

TEST(Predictive, AValueThatIsNotThereSaysNothing) {
  const GaussianNoise independent = GaussianNoise::independent(Eigen::Vector2d(0.5, 2));
  const Eigen::Vector2d values(k_missing, 1);
  const Eigen::MatrixXd found = pointwise_log_likelihoods(Eigen::MatrixXd::Zero(2, 1), values, independent);
  EXPECT_EQ(found(0, 0), 0);
  EXPECT_NEAR(found(1, 0), log_density(Eigen::VectorXd::Ones(1), Eigen::MatrixXd::Constant(1, 1, 4)), 1e-14);
  EXPECT_TRUE(can_be_split(values, independent));
  // With correlated noise the others' density would be that of the values that are there.
  EXPECT_FALSE(can_be_split(Eigen::Vector4d(1, k_missing, 1, 1), GaussianNoise::of_covariance(covariance())));
}

/// By the joint Gaussian of error and residual: E[F z | r] = F Fᵀ (F Fᵀ + R)⁻¹ r, of the values that are
/// there.
TEST(Predictive, TheExpectedErrorOfAStepIsThatOfTheJointGaussian) {
  const Eigen::MatrixXd factor{{1, 0.5}, {-0.3, 2}, {0.7, 0.1}, {1.2, -1}};
  const Eigen::MatrixXd shape{{1, 0.2, 0, 0.1}, {0, 0.8, 0.3, 0}, {0.1, 0, 1.1, 0.2}, {0, 0.4, 0, 0.9}};
  const Eigen::MatrixXd covariance = shape * shape.transpose();
  const Eigen::VectorXd residual{{0.4, std::numeric_limits<double>::quiet_NaN(), -1.1, 2.5}};
  const std::vector<Eigen::Index> there = {0, 2, 3};
  const Eigen::MatrixXd of_error = factor * factor.transpose();
  const Eigen::VectorXd expected =
      of_error(Eigen::all, there) * (of_error + covariance)(there, there).inverse() * residual(there);
  const Eigen::VectorXd found =
      expected_step_error(residual, GaussianNoise::of_covariance(covariance), factor);
  EXPECT_LT((found - expected).norm(), 1e-12);
}

}  // namespace
}  // namespace knothe::likelihood
