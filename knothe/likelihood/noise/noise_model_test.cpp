#include "knothe/likelihood/noise/noise_model.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "knothe/base/error.hpp"

namespace knothe::likelihood {
namespace {

/// A sparse precision: second differences plus a multiple of the identity.
Eigen::SparseMatrix<double> chain(Eigen::Index n) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < n; ++i) {
    entries.emplace_back(i, i, 2.5 + 0.1 * i);
    if (i > 0) {
      entries.emplace_back(i, i - 1, -1.0);
      entries.emplace_back(i - 1, i, -1.0);
    }
  }
  Eigen::SparseMatrix<double> m(n, n);
  m.setFromTriplets(entries.begin(), entries.end());
  return m;
}

TEST(NoiseModel, IndependentNoise) {
  const Eigen::Vector3d std(1e-6, 2e-6, 5e-7);
  const NoiseModel noise = NoiseModel::independent(std);
  const Eigen::Vector3d x(1, -2, 3);
  EXPECT_TRUE(noise.measurement().apply(x).col(0).isApprox(x.cwiseQuotient(std.cwiseAbs2()), 1e-14));
  EXPECT_NEAR(noise.measurement().log_determinant(), 2 * std.array().log().sum(), 1e-12);
  EXPECT_TRUE(noise.measurement().standard_deviations().isApprox(std, 1e-14));
}

TEST(NoiseModel, CorrelatedNoiseAgainstDenseAlgebra) {
  const auto sparse = chain(9);
  const Eigen::MatrixXd covariance = Eigen::MatrixXd(sparse).inverse();
  const NoiseModel noise = NoiseModel::correlated(sparse);
  EXPECT_NEAR(noise.measurement().log_determinant(), std::log(covariance.determinant()), 1e-12);
  EXPECT_TRUE(noise.measurement().standard_deviations().isApprox(covariance.diagonal().cwiseSqrt(), 1e-12));
}

TEST(NoiseModel, PrecisionOfASubsetIsThatOfTheMarginal) {
  const auto sparse = chain(9);
  const Eigen::MatrixXd covariance = Eigen::MatrixXd(sparse).inverse();
  const std::vector<Eigen::Index> kept = {0, 3, 4, 8};
  const Eigen::MatrixXd marginal = covariance(kept, kept);
  const NoiseModel noise = NoiseModel::correlated(sparse).restricted(kept);
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(4, 4);
  EXPECT_TRUE(noise.measurement().apply(identity).isApprox(marginal.inverse(), 1e-12));
  EXPECT_NEAR(noise.measurement().log_determinant(), std::log(marginal.determinant()), 1e-12);
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const DataError& error) {
    return error.what();
  }
  return "no error";
}

TEST(NoiseModel, BadNoiseIsRefused) {
  EXPECT_EQ(message_of([] { (void)NoiseModel::independent(Eigen::Vector2d(1e-6, -1e-6)); }),
            "noise/std[1] is -1e-06: a standard deviation is positive and finite");
  EXPECT_EQ(message_of([] { (void)NoiseModel::independent(Eigen::Vector2d(1e-200, 1e-6)); }),
            "noise/std[0] is 1e-200: too small for its square to be a number");
  EXPECT_EQ(message_of([] {
              auto m = chain(4);
              m.coeffRef(0, 1) = 0.5;
              (void)NoiseModel::correlated(m);
            }),
            "noise/precision is not symmetric: store the full symmetric matrix");
  EXPECT_EQ(message_of([] { (void)NoiseModel::correlated(Eigen::SparseMatrix<double>(-1 * chain(4))); }),
            "noise/precision is not positive definite: it must be the inverse of a covariance matrix");
}

TEST(NoiseModel, OfADenseCovarianceIsCheckedAndInverted) {
  EXPECT_THROW((void)GaussianNoise::of_covariance(Eigen::MatrixXd::Ones(2, 2)), UsageError);
  EXPECT_THROW((void)GaussianNoise::of_covariance((Eigen::Matrix2d() << 1, 0.5, 0.4, 1).finished()),
               UsageError);
  EXPECT_THROW((void)GaussianNoise::of_covariance(Eigen::MatrixXd::Ones(2, 3)), UsageError);
  const Eigen::Matrix2d covariance = (Eigen::Matrix2d() << 4, 1, 1, 9).finished();
  const GaussianNoise noise = GaussianNoise::of_covariance(covariance);
  const Eigen::Vector2d x(1, 2);
  EXPECT_LT((noise.apply(Eigen::MatrixXd(x)) - covariance.inverse() * x).norm(), 1e-14);
  EXPECT_NEAR(noise.log_determinant(), std::log(35), 1e-13);
}

TEST(GaussianNoise, AnErrorThatDofsShareIsAppliedAsTheDenseSum) {
  const Eigen::MatrixXd factor = (Eigen::MatrixXd(3, 2) << 1, 0, 2, -1, 0.5, 3).finished();
  const Eigen::MatrixXd x = (Eigen::MatrixXd(3, 2) << 1, 4, -2, 5, 3, 6).finished();
  for (const GaussianNoise& noise :
       {GaussianNoise::independent(Eigen::Vector3d(0.5, 2, 1)), GaussianNoise::correlated(chain(3))}) {
    const Eigen::Matrix3d sum = Eigen::MatrixXd(noise.precision()).inverse() + factor * factor.transpose();
    EXPECT_LT((apply_with_error(noise, factor, x) - sum.inverse() * x).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace knothe::likelihood
