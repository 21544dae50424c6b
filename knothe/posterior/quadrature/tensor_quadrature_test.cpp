#include "knothe/posterior/quadrature/tensor_quadrature.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <numbers>

#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/quadrature/filled_quadrature.hpp"

namespace knothe::posterior {
namespace {

/// Weighted sum of Gaussians, normalised to `mass`.
class Mixture final : public LogDensity {
 public:
  struct Part {
    double weight;
    Eigen::VectorXd mean;
    Eigen::MatrixXd covariance;
  };
  explicit Mixture(std::vector<Part> parts) : parts_(std::move(parts)) {}
  [[nodiscard]] Eigen::Index dimension() const override { return parts_[0].mean.size(); }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int, LogDensityBatch& out) override {
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      Eigen::VectorXd log_density(static_cast<Eigen::Index>(parts_.size()));
      for (std::size_t k = 0; k < parts_.size(); ++k) {
        const Part& part = parts_[k];
        const Eigen::VectorXd e = z.row(i).transpose() - part.mean;
        log_density[static_cast<Eigen::Index>(k)] =
            std::log(part.weight) - 0.5 * e.dot(part.covariance.inverse() * e) -
            0.5 * std::log((2 * std::numbers::pi * part.covariance).determinant());
      }
      const double largest = log_density.maxCoeff();
      out.value[i] = largest + std::log((log_density.array() - largest).exp().sum());
    }
  }

 private:
  std::vector<Part> parts_;
};

TEST(TensorQuadrature, NarrowCorrelatedGaussian) {
  // Standard deviations of 0.03 and 0.05, correlation 0.98, away from the centre of the window.
  Eigen::Matrix2d covariance;
  covariance << 9e-4, 0.98 * 0.03 * 0.05, 0.98 * 0.03 * 0.05, 25e-4;
  Mixture target({{std::exp(-7.0), Eigen::Vector2d(1.7, -2.2), covariance}});
  const QuadraturePosterior q = tensor_quadrature(target);
  const Eigen::Vector2d mean = q.points().transpose() * q.weights;
  const Eigen::MatrixXd e = q.points().rowwise() - mean.transpose();
  const Eigen::Matrix2d found = e.transpose() * q.weights.asDiagonal() * e;
  EXPECT_NEAR(q.log_evidence, -7.0, 1e-6);
  EXPECT_LT(q.evidence_change, 1e-3);
  EXPECT_NEAR(mean[0], 1.7, 1e-6);
  EXPECT_LT((found - covariance).cwiseAbs().maxCoeff(), 1e-6 * 25e-4);
  EXPECT_NEAR((q.quantiles(1, 4) + 2.2) / 0.05, 1.959963984540054, 1e-2);
  EXPECT_NEAR((q.quantiles(0, 0) - 1.7) / 0.03, -1.959963984540054, 1e-2);
}

TEST(TensorQuadrature, SeparatedModesAreAllThere) {
  const Eigen::Matrix2d narrow = 0.01 * Eigen::Matrix2d::Identity();
  Mixture target({{0.7, Eigen::Vector2d(-2, 1), narrow}, {0.3, Eigen::Vector2d(2.5, -1), 4 * narrow}});
  const QuadraturePosterior q = tensor_quadrature(target);
  const Eigen::Vector2d mean = q.points().transpose() * q.weights;
  EXPECT_NEAR(q.log_evidence, 0, 1e-6);
  EXPECT_NEAR(mean[0], 0.7 * -2 + 0.3 * 2.5, 1e-6);
  EXPECT_NEAR(mean[1], 0.7 - 0.3, 1e-6);
}

TEST(TensorQuadrature, OfAFineGridNoMorePointsAreTakenThanCarryTheRule) {
  Eigen::Matrix2d covariance;
  covariance << 9e-4, 0.5 * 0.03 * 0.05, 0.5 * 0.03 * 0.05, 25e-4;
  Mixture target({{1, Eigen::Vector2d(1.7, -2.2), covariance}});
  const QuadraturePosterior q = tensor_quadrature(target, {.coarse_nodes = 301, .whole_range = true});
  const Eigen::Vector2d mean = q.points().transpose() * q.weights;
  const Eigen::MatrixXd e = q.points().rowwise() - mean.transpose();
  EXPECT_GT(q.evaluations, 90'000);
  EXPECT_LT(q.weights.size(), 40'000);
  EXPECT_NEAR(q.weights.sum(), 1, 1e-12);
  EXPECT_NEAR(q.weights(q.every_other).sum(), 0.25, 1e-3);
  EXPECT_LT((mean - Eigen::Vector2d(1.7, -2.2)).norm(), 1e-6);
  EXPECT_LT((e.transpose() * q.weights.asDiagonal() * e - covariance).cwiseAbs().maxCoeff(), 1e-5 * 25e-4);
}

TEST(FilledQuadrature, ARidgeAndASmallModeAwayFromIt) {
  // A ridge a fifth as wide as it is long, and a small mode away from it.
  Eigen::Matrix3d ridge;
  ridge << 4e-2, 3.8e-2, 0, 3.8e-2, 4e-2, -0.005, 0, -0.005, 1e-2;
  const Eigen::Vector3d at(0.5, -1, 2), away(-2, 1.5, -1);
  Mixture target({{0.9, at, ridge}, {0.1, away, 0.01 * Eigen::Matrix3d::Identity()}});
  ModeSearch search;
  const QuadraturePosterior q = filled_quadrature(target, {}, search);
  const Eigen::Vector3d mean = q.points().transpose() * q.weights, exact = 0.9 * at + 0.1 * away;
  const Eigen::MatrixXd e = q.points().rowwise() - mean.transpose();
  const Eigen::Matrix3d found = e.transpose() * q.weights.asDiagonal() * e;
  const Eigen::Matrix3d covariance =
      0.9 * ridge + 0.001 * Eigen::Matrix3d::Identity() + 0.09 * (at - away) * (at - away).transpose();
  EXPECT_TRUE(q.resolved());
  EXPECT_NEAR(q.log_evidence, 0, 1e-4);
  EXPECT_LT((mean - exact).norm(), 1e-4);
  EXPECT_LT((found - covariance).cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_LT(q.evaluations, 200'000);
}

TEST(FilledQuadrature, JoinedPartsAreTheirSum) {
  // The wide part is two hundred times as wide as the narrow one, which holds a third of the mass.
  const Eigen::Vector3d at(0.5, -1, 2), beside(0.4, -1.1, 2.1);
  Mixture narrow({{0.1, at, 2.5e-5 * Eigen::Matrix3d::Identity()}});
  Mixture wide({{0.2, beside, Eigen::Matrix3d::Identity()}});
  ModeSearch search;
  const std::array parts{filled_quadrature(narrow, {}, search), filled_quadrature(wide, {}, search)};
  const QuadraturePosterior q = joined(parts);
  EXPECT_TRUE(q.resolved());
  EXPECT_NEAR(q.log_evidence, std::log(0.3), 1e-4);
  EXPECT_NEAR(q.weights.sum(), 1, 1e-12);
  EXPECT_LT(q.weights.size(), 20'000);
  const Eigen::Vector3d mean = q.points().transpose() * q.weights, exact = at / 3 + 2 * beside / 3;
  EXPECT_LT((mean - exact).norm(), 1e-4);
  const Eigen::MatrixXd e = q.points().rowwise() - mean.transpose();
  const Eigen::Matrix3d covariance = (2.5e-5 / 3 + 2.0 / 3) * Eigen::Matrix3d::Identity() +
                                     2.0 / 9 * (at - beside) * (at - beside).transpose();
  EXPECT_LT((e.transpose() * q.weights.asDiagonal() * e - covariance).cwiseAbs().maxCoeff(), 1e-3);
  for (Eigen::Index k = 0; k < 3; ++k)
    for (std::size_t j = 0; j < numerics::k_quantile_levels.size(); ++j) {
      const double x = q.quantiles(k, static_cast<Eigen::Index>(j));
      const double below =
          numerics::normal_cdf((x - at[k]) / 5e-3) / 3 + 2 * numerics::normal_cdf(x - beside[k]) / 3;
      EXPECT_NEAR(below, numerics::k_quantile_levels[j], 4e-3) << k;  // nodes a standard deviation apart
    }
}

/// What data say that are 10⁹ standard deviations from anything that the model can give.
class Absurd final : public LogDensity {
 public:
  explicit Absurd(Eigen::Index dimension) : dimension_(dimension) {}
  [[nodiscard]] Eigen::Index dimension() const override { return dimension_; }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int, LogDensityBatch& out) override {
    out.value = -1e18 * (1 + 1e-3 * ((points.array() - 30).square().rowwise().sum()));
  }

 private:
  Eigen::Index dimension_;
};

TEST(TensorQuadrature, AMaximumWhoseDepthRoundingHidesIsStillFound) {
  for (const bool filled : {false, true}) {
    Absurd target(filled ? 3 : 2);
    ModeSearch search;
    const QuadraturePosterior q = filled ? filled_quadrature(target, {}, search) : tensor_quadrature(target);
    ASSERT_GT(q.weights.size(), 0) << filled;
    EXPECT_TRUE(q.points().allFinite() && q.weights.allFinite()) << filled;
    EXPECT_NEAR(q.weights.sum(), 1, 1e-9) << filled;
  }
}

TEST(TensorQuadrature, OneParameter) {
  Mixture target({{1.0, Eigen::VectorXd::Constant(1, 0.4), Eigen::MatrixXd::Constant(1, 1, 1e-4)}});
  const QuadraturePosterior q = tensor_quadrature(target);
  EXPECT_NEAR(q.log_evidence, 0, 1e-8);
  EXPECT_NEAR(q.quantiles(0, 1), 0.4 - 0.6744897501960817 * 0.01, 1e-5);
}

}  // namespace
}  // namespace knothe::posterior
