#include "knothe/sampling/conditional_laplace.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/sampling/testing/test_mixtures.hpp"
#include "knothe/sampling/testing/test_targets.hpp"

namespace knothe::sampling {
namespace {

/// Neal's funnel: v ~ N(0, 1) last, the others N(0, e^v). Its mode is where v = −m/2, far from its mass; all
/// moments are known. Evidence 1.
struct Funnel : LogDensity {
  Eigen::Index others;
  explicit Funnel(Eigen::Index m) : others(m) {}
  [[nodiscard]] Eigen::Index dimension() const override { return others + 1; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
    const auto m = static_cast<double>(others);
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      const double v = z(i, others), precision = std::exp(-v), squared = z.row(i).head(others).squaredNorm();
      out.value[i] =
          -0.5 * (v * v + m * v + precision * squared + (m + 1) * std::log(2 * std::numbers::pi));
      if (order < 1) continue;
      out.gradient.row(i).head(others) = -precision * z.row(i).head(others);
      out.gradient(i, others) = -v - 0.5 * m + 0.5 * precision * squared;
      if (order < 2) continue;
      out.hessian.row(i).setZero();
      for (Eigen::Index k = 0; k < others; ++k) {
        out.hessian(i, packed_index(k, k)) = -precision;
        out.hessian(i, packed_index(others, k)) = precision * z(i, k);
      }
      out.hessian(i, packed_index(others, others)) = -1 - 0.5 * precision * squared;
    }
  }
};

TEST(ConditionalLaplace, FunnelsOfAnyDimension) {
  for (const Eigen::Index others : {3, 10, 40}) {
    Funnel target(others);
    const ConditionalLaplaceResult r = conditional_laplace(target);
    if (others > 3) {
      EXPECT_EQ(r.leading, std::vector<Eigen::Index>{others});
    }
    EXPECT_TRUE(r.converged) << others << ": " << r.mean_error << ", " << r.deviation_error;
    EXPECT_FALSE(r.second_mode_found) << others;
    const Eigen::VectorXd mean = mean_of(r.sample);
    const Eigen::MatrixXd covariance = covariance_of(r.sample);
    for (Eigen::Index k = 0; k <= others; ++k) {
      const double deviation = k < others ? std::exp(0.25) : 1;
      EXPECT_NEAR(mean[k] / deviation, 0, r.mean_error) << others << ", " << k;
      EXPECT_NEAR(std::sqrt(covariance(k, k)) / deviation, 1, r.deviation_error) << others << ", " << k;
    }
    EXPECT_NEAR(r.sample.log_evidence, 0, 5 * r.sample.log_evidence_error) << others;
  }
}

TEST(ConditionalLaplace, GaussiansHaveEvenWeights) {
  RandomNumbers random(7);
  const Eigen::MatrixXd covariance = targets::random_covariance(6, 2, 5, random);
  const Eigen::VectorXd mean = random.normals(6, 1).col(0);
  targets::Gaussian target(mean, covariance.inverse(), -3);
  const ConditionalLaplaceResult r = conditional_laplace(target);
  EXPECT_TRUE(r.converged);
  EXPECT_GT(r.sample.effective_size, 0.7 * static_cast<double>(r.sample.weights.size()));
  EXPECT_NEAR(r.sample.log_evidence, -3, 5 * r.sample.log_evidence_error);
  const ConditionalLaplaceResult again = conditional_laplace(target);
  EXPECT_EQ(again.sample.points, r.sample.points);
  EXPECT_EQ(again.sample.weights, r.sample.weights);
}

TEST(ConditionalLaplace, ASecondModeIsNoPartOfTheAnswer) {
  targets::Mixture target({{0.7, Eigen::Vector2d(-2, 0), 9 * Eigen::Matrix2d::Identity()},
                           {0.3, Eigen::Vector2d(2, 1), 9 * Eigen::Matrix2d::Identity()}});
  const ConditionalLaplaceResult r = conditional_laplace(target);
  EXPECT_TRUE(r.second_mode_found);
  EXPECT_FALSE(r.converged);
}

TEST(ConditionalLaplace, WhatItNeedsIsSaid) {
  const auto complaint = [](LogDensity& target) {
    try {
      (void)conditional_laplace(target);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  targets::Gaussian values(Eigen::Vector3d::Zero(), Eigen::Matrix3d::Identity());
  values.derivatives = 1;
  EXPECT_EQ(complaint(values),
            "conditional Laplace: a density in 3 dimensions with derivatives of order 1; at least 2 of each are "
            "needed");
  targets::Gaussian one(Eigen::VectorXd::Zero(1), Eigen::MatrixXd::Identity(1, 1));
  EXPECT_EQ(complaint(one),
            "conditional Laplace: a density in 1 dimensions with derivatives of order 2; at least 2 of each are "
            "needed");
}

}  // namespace
}  // namespace knothe::sampling
