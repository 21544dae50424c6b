#include "knothe/posterior/draws/mixture.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/posterior/draws/mixture_fit.hpp"

namespace knothe::posterior {
namespace {

MixtureComponent component(double weight, Eigen::Vector2d centre, double a, double b, double c) {
  Eigen::Matrix2d lower;
  lower << a, 0, b, c;
  return {weight, centre, lower};
}

/// Two Gaussians, written out.
double two_gaussians(const std::vector<MixtureComponent>& parts, const Eigen::Vector2d& x) {
  double sum = 0, total = 0;
  for (const auto& part : parts) total += part.weight;
  for (const auto& part : parts) {
    const Eigen::Matrix2d covariance = part.lower * part.lower.transpose();
    const Eigen::Vector2d off = x - part.centre;
    sum += part.weight / total / (2 * std::numbers::pi * std::sqrt(covariance.determinant())) *
           std::exp(-0.5 * off.dot(covariance.inverse() * off));
  }
  return std::log(sum);
}

TEST(Mixture, DensityIsThatOfItsFormula) {
  const std::vector<MixtureComponent> parts = {component(2, {1, -1}, 0.5, 0.3, 1.2),
                                               component(1, {-3, 2}, 2, -0.4, 0.1)};
  const Mixture mixture(parts);
  const Eigen::MatrixXd points = 3 * Eigen::MatrixXd::Random(600, 2);
  Eigen::VectorXd value, alone;
  mixture.log_density(points, value);
  for (Eigen::Index i = 0; i < points.rows(); i += 37)
    EXPECT_NEAR(value[i], two_gaussians(parts, points.row(i).transpose()), 1e-11 * (1 + std::abs(value[i])));
  mixture.log_density(points.row(299), alone);
  EXPECT_EQ(alone[0], value[299]) << "a value must not depend on the other points";
}

TEST(Mixture, StudentsTIsNormalisedAndDrawnAsItSays) {
  const Mixture one({{1.0, Eigen::VectorXd::Constant(1, 0.5), Eigen::MatrixXd::Constant(1, 1, 2)}}, 4);
  // Student's t with 4 degrees of freedom at 0 is 3/8; P(|t| > 2.776445) = 0.05.
  Eigen::VectorXd value;
  one.log_density(Eigen::MatrixXd::Constant(1, 1, 0.5), value);
  EXPECT_NEAR(value[0], std::log(0.375 / 2), 1e-12);
  RandomNumbers random(3);
  const Eigen::MatrixXd drawn = one.sample(200000, random);
  const double outside = ((drawn.array() - 0.5).abs() > 2 * 2.776445).cast<double>().mean();
  EXPECT_NEAR(outside, 0.05, 4 * std::sqrt(0.05 * 0.95 / 200000));
}

TEST(Mixture, EveryComponentHasItsShareOfTheDraws) {
  const Mixture mixture({component(99, {0, 0}, 0.1, 0, 0.1), component(1, {50, 0}, 0.1, 0, 0.1)}, 6);
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    RandomNumbers random(seed);
    const Eigen::MatrixXd drawn = mixture.sample(1000, random);
    EXPECT_EQ((drawn.col(0).array() > 25).count(), 10) << seed;
  }
}

TEST(Mixture, RefusesWhatIsNone) {
  const auto message_of = [](auto&& make) -> std::string {
    try {
      make();
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(message_of([] { Mixture({}); }), testing::HasSubstr("no components"));
  EXPECT_THAT(message_of([] {
                Mixture({component(0, {0, 0}, 1, 0, 1)});
              }),
              testing::HasSubstr("must be positive"));
  EXPECT_THAT(message_of([] {
                Mixture({component(1, {0, 0}, 1, 0, 1)}, 5);
              }),
              testing::HasSubstr("5 degrees of freedom; they are an even number"));
}

TEST(MixtureFit, FindsTwoGaussiansAndKeepsOneWhole) {
  const std::vector<MixtureComponent> truth = {component(0.7, {2, 0}, 0.5, 0.2, 0.3),
                                               component(0.3, {-2, 1}, 0.2, 0, 0.8)};
  RandomNumbers random(5);
  const Eigen::Index n = 6000;
  const Eigen::MatrixXd points = Mixture(truth).sample(n, random);
  const Eigen::VectorXd weights = Eigen::VectorXd::Constant(n, 1.0 / n);
  std::vector<MixtureComponent> found = fit_mixture(points, weights);
  ASSERT_EQ(found.size(), 2U);
  if (found[0].weight < found[1].weight) std::swap(found[0], found[1]);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_NEAR(found[k].weight, truth[k].weight, 0.01);
    EXPECT_LT((found[k].centre - truth[k].centre).norm(), 0.05);
    EXPECT_LT(
        (found[k].lower * found[k].lower.transpose() - truth[k].lower * truth[k].lower.transpose()).norm(),
        0.05);
  }
  const Eigen::MatrixXd whole = Mixture({truth[0]}).sample(n, random);
  EXPECT_EQ(fit_mixture(whole, weights).size(), 1U);
}

TEST(MixtureFit, WeightsCountAsSoManyPoints) {
  // Points of a uniform square, weighted as a Gaussian: the fit is that Gaussian.
  RandomNumbers random(6);
  const Eigen::Index n = 20000;
  Eigen::MatrixXd points(n, 2);
  Eigen::VectorXd weights(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    points.row(i) << 10 * random.uniform() - 5, 10 * random.uniform() - 5;
    weights[i] = std::exp(-0.5 * ((points.row(i) - Eigen::RowVector2d(0.5, -0.5)).squaredNorm() / 0.64));
  }
  weights /= weights.sum();
  const auto found = fit_mixture(points, weights);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(found[0].centre[0], 0.5, 0.06);
  EXPECT_NEAR(found[0].lower(0, 0), 0.8, 0.04);
}

}  // namespace
}  // namespace knothe::posterior
