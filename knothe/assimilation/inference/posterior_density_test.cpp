#include "knothe/assimilation/inference/posterior_density.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/model/testing/forward_models.hpp"

namespace knothe::assimilation {
namespace {

using posterior::packed_index;
using posterior::Prior;

const std::vector<Prior> k_priors = {Prior::lognormal(0.1, 0.4), Prior::uniform(-1.0, 2.0)};

Observations three_values() {
  Eigen::Matrix3d covariance;
  covariance << 0.04, 0.01, 0, 0.01, 0.09, -0.02, 0, -0.02, 0.16;
  return {Eigen::Vector3d(1.2, 0.7, 0.4), likelihood::GaussianNoise::of_covariance(covariance)};
}

/// log N(y; f, R) written out, without any of the code under test.
double written_out(const Eigen::Vector2d& p) {
  Eigen::Matrix3d covariance;
  covariance << 0.04, 0.01, 0, 0.01, 0.09, -0.02, 0, -0.02, 0.16;
  const Eigen::Vector3d r = Eigen::Vector3d(1.2, 0.7, 0.4) -
                            Eigen::Vector3d(p[0] * std::exp(p[1]), p[0] * p[0] + p[1], std::sin(p[1]));
  return -0.5 * r.dot(covariance.inverse() * r) - 0.5 * std::log(covariance.determinant()) -
         1.5 * std::log(2 * std::numbers::pi);
}

Eigen::Vector2d parameters_of(double x, double y) {
  return {std::exp(0.1 + 0.4 * x), -1 + 3 * 0.5 * std::erfc(-y / std::numbers::sqrt2)};
}

const Eigen::MatrixXd k_points = (Eigen::MatrixXd(4, 2) << 0, 0, 0.5, -0.7, -1.5, 1.2, 2.0, 2.5).finished();

class Derivatives : public testing::TestWithParam<int> {};

/// Whatever the model gives of itself, value and gradient are those of the formula; the Hessian too where the
/// model has second derivatives, and where the residual vanishes (then Gauss–Newton is exact).
TEST_P(Derivatives, AgreeWithTheFormula) {
  model::test_models::Smooth model;
  model.gradient_too = GetParam() == 1 || GetParam() == 3;
  model.jacobian_too = GetParam() >= 2;
  model.hessian_too = GetParam() == 3;
  ModelEvaluator evaluator(model, k_priors, 1e-4);
  PosteriorDensity density(evaluator, k_priors, three_values());
  posterior::LogDensityBatch batch;
  batch.resize(4, 2, 2);
  density.evaluate(k_points, 2, batch);
  const auto exact = [](double x, double y) {
    return written_out(parameters_of(x, y)) - 0.5 * (x * x + y * y) - std::log(2 * std::numbers::pi);
  };
  for (Eigen::Index i = 0; i < 4; ++i) {
    const double x = k_points(i, 0), y = k_points(i, 1), h = 1e-4;
    EXPECT_NEAR(batch.value[i], exact(x, y), 1e-9 * std::abs(exact(x, y)) + 1e-10);
    const double gx = (exact(x + h, y) - exact(x - h, y)) / (2 * h),
                 gy = (exact(x, y + h) - exact(x, y - h)) / (2 * h);
    EXPECT_NEAR(batch.gradient(i, 0), gx, 1e-5 * (1 + std::abs(gx)));
    EXPECT_NEAR(batch.gradient(i, 1), gy, 1e-5 * (1 + std::abs(gy)));
    if (!model.hessian_too) continue;
    const double xx = (exact(x + h, y) - 2 * exact(x, y) + exact(x - h, y)) / (h * h);
    const double xy =
        (exact(x + h, y + h) - exact(x + h, y - h) - exact(x - h, y + h) + exact(x - h, y - h)) / (4 * h * h);
    EXPECT_NEAR(batch.hessian(i, packed_index(0, 0)), xx, 1e-4 * (1 + std::abs(xx)));
    EXPECT_NEAR(batch.hessian(i, packed_index(1, 0)), xy, 1e-4 * (1 + std::abs(xy)));
  }
}
INSTANTIATE_TEST_SUITE_P(OfAllKinds, Derivatives, testing::Values(0, 1, 2, 3));

TEST(PosteriorDensity, NothingIsEvaluatedTwice) {
  model::test_models::Smooth model;
  ModelEvaluator evaluator(model, k_priors, 1e-4);
  PosteriorDensity density(evaluator, k_priors, three_values());
  posterior::LogDensityBatch batch;
  batch.resize(4, 2, 2);
  density.evaluate(k_points, 0, batch);
  EXPECT_EQ(model.calls().evaluations, 4);
  density.evaluate(k_points, 0, batch);
  EXPECT_EQ(model.calls().evaluations, 4);
  density.evaluate(k_points, 2, batch);
  EXPECT_EQ(model.calls().evaluations, 4 + 4 * 4);
}

/// A log-density in p carried to z: with the exact density of the priors themselves it becomes N(0, I).
TEST(PosteriorDensity, ADensityThatIsThePriorBecomesStandardNormal) {
  const std::vector<Prior> priors = {Prior::lognormal(0.1, 0.4), Prior::uniform(-1.0, 2.0),
                                     Prior::normal(3, 2)};
  model::test_models::Scalar model(3, [&](const Eigen::VectorXd& p) {
    return priors[0].log_density(p[0]) + priors[1].log_density(p[1]) + priors[2].log_density(p[2]);
  });
  ModelEvaluator evaluator(model, priors, 1e-4);
  PosteriorDensity density(evaluator, priors, std::nullopt);
  const Eigen::MatrixXd z = (Eigen::MatrixXd(3, 3) << 0, 0, 0, 1, -1, 2, -2, 1.5, 0.5).finished();
  posterior::LogDensityBatch batch;
  batch.resize(3, 3, 2);
  density.evaluate(z, 2, batch);
  for (Eigen::Index i = 0; i < 3; ++i) {
    EXPECT_NEAR(batch.value[i], -0.5 * z.row(i).squaredNorm() - 1.5 * std::log(2 * std::numbers::pi), 1e-9);
    for (Eigen::Index a = 0; a < 3; ++a) {
      EXPECT_NEAR(batch.gradient(i, a), -z(i, a), 1e-5);
      for (Eigen::Index b = 0; b <= a; ++b)
        EXPECT_NEAR(batch.hessian(i, packed_index(a, b)), a == b ? -1 : 0, 1e-4);
    }
  }
}

TEST(PosteriorDensity, AVeryLowLogDensityIsZeroDensity) {
  const std::vector<Prior> priors = {Prior::normal(0, 1)};
  model::test_models::Scalar model(1, [](const Eigen::VectorXd& p) { return p[0] < 0 ? -1.7e308 : -p[0]; });
  ModelEvaluator evaluator(model, priors, 1e-4);
  PosteriorDensity density(evaluator, priors, std::nullopt);
  posterior::LogDensityBatch batch;
  batch.resize(3, 1, 2);
  density.evaluate(Eigen::Vector3d(-1, 0, 1), 2, batch);
  EXPECT_EQ(batch.value[0], -std::numeric_limits<double>::infinity());
  EXPECT_TRUE(batch.gradient.allFinite() && batch.hessian.allFinite());
  EXPECT_NEAR(batch.gradient(2, 0), -1, 1e-6);
}

/// A model that writes only part of its buffer, or what is not a number.
TEST(ModelEvaluator, WhatIsNotWrittenOrNotFiniteIsFoundOut) {
  struct Lazy : model::test_models::Scalar {
    using Scalar::Scalar;
    void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points,
                  Eigen::Ref<Eigen::MatrixXd> values) override {
      values.leftCols(points.cols() - 1).setZero();
    }
  };
  Lazy model(1, nullptr);
  ModelEvaluator evaluator(model, {Prior::normal(0, 1)}, 1e-4);
  Eigen::MatrixXd values;
  try {
    evaluator.evaluate(Eigen::RowVector3d(1, 2, 3), values);
    FAIL();
  } catch (const DataError& error) {
    EXPECT_STREQ(error.what(), "scalar model: the output at (3) is not finite (entry 0 is nan)");
  }
}

TEST(ModelEvaluator, DifferencesStayInsideTheSupport) {
  model::test_models::Scalar model(1, [](const Eigen::VectorXd& p) {
    EXPECT_GE(p[0], -1);
    EXPECT_LE(p[0], 2);
    return p[0] * p[0] * p[0];
  });
  ModelEvaluator evaluator(model, {Prior::uniform(-1, 2)}, 1e-4);
  Eigen::MatrixXd jacobian, hessian;
  const Eigen::RowVector3d points(-1, 0.5, 2);
  evaluator.jacobian(points, jacobian);
  evaluator.hessian(points, Eigen::RowVector3d::Ones(), hessian);
  for (Eigen::Index i = 0; i < 3; ++i) {
    EXPECT_NEAR(jacobian(0, i), 3 * points[i] * points[i], 1e-5);
    EXPECT_NEAR(hessian(0, i), 6 * points[i], 1e-2);
  }
}

}  // namespace
}  // namespace knothe::assimilation
