#include "knothe/posterior/draws/control_variates.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

namespace knothe::posterior {
namespace {

Mixture gaussians(std::vector<std::array<double, 3>> weights_centres_scales,
                  double tails = std::numeric_limits<double>::infinity()) {
  std::vector<MixtureComponent> components;
  for (const auto& [weight, centre, scale] : weights_centres_scales)
    components.push_back(
        {weight, Eigen::VectorXd::Constant(1, centre), Eigen::MatrixXd::Constant(1, 1, scale)});
  return Mixture(std::move(components), tails);
}

/// Weights of draws of q for the target exp(log_target).
Eigen::VectorXd weights_of(const Eigen::VectorXd& log_target, const Eigen::VectorXd& log_q) {
  Eigen::VectorXd weights = (log_target - log_q).array().exp();
  return weights / weights.sum();
}

TEST(ControlVariates, OfTheTargetItselfMakeMomentsExact) {
  std::vector<MixtureProduct::Factor> factors;
  factors.push_back({{0}, gaussians({{1, 0, 1}})});  // with an end at 0: half normal
  factors.push_back({{1}, gaussians({{0.3, -1, 0.5}, {0.7, 2, 1}})});
  factors.push_back({{2}, gaussians({{1, 0.9, 0.4}})});  // with an end at 1
  SupportEnds ends = SupportEnds::none(3);
  ends.lower[0] = 0, ends.upper[2] = 1;
  std::vector<MixtureProduct::Factor> wide;
  for (Eigen::Index k = 0; k < 3; ++k) wide.push_back({{k}, gaussians({{1, 0.5, 1.5}}, 8)});
  const MixtureProduct q(wide), target(factors, ends, 0);
  RandomNumbers random(7);
  Eigen::MatrixXd points;
  Eigen::VectorXd log_q, log_target;
  q.sample(4000, random, points);
  q.log_density(points, log_q);
  target.log_density(points, log_target);
  const Eigen::VectorXd weights = weights_of(log_target, log_q);
  const auto found = calibrate(control_variates(target, points, log_q, {}, random), weights, points);
  ASSERT_TRUE(found);
  const Eigen::VectorXd mean = points.transpose() * found->weights,
                        second = points.cwiseAbs2().transpose() * found->weights;
  EXPECT_NEAR(mean[0], std::sqrt(2 / std::numbers::pi), 0.012);
  EXPECT_NEAR(second[0], 1, 0.012);
  EXPECT_NEAR(mean[1], 0.3 * -1 + 0.7 * 2, 0.012);
  EXPECT_NEAR(second[1], 0.3 * 1.25 + 0.7 * 5, 0.012);
  // 1 − |x − 1| of N(0.9, 0.4²).
  const double t = 0.25, folded = 0.1 * std::erf(t / std::numbers::sqrt2) +
                                  0.8 * std::exp(-0.5 * t * t) / std::sqrt(2 * std::numbers::pi);
  EXPECT_NEAR(mean[2], 1 - folded, 0.012);
  const MomentErrors before = standard_errors(points, weights);
  EXPECT_NEAR(found->errors.mean, before.mean / 1.5, 1e-12);
  EXPECT_NEAR(found->errors.deviation, before.deviation / 1.5, 1e-12);
}

/// A Laplace density by draws of a wide proposal, helped by two Gaussians: less than half of the error is
/// made, and no more than is stated.
TEST(ControlVariates, LowerTheErrorsThatAreMade) {
  constexpr int k_repeats = 200;
  std::vector<MixtureProduct::Factor> factors, wide;
  factors.push_back({{0}, gaussians({{0.5, 0, 0.7}, {0.5, 0, 1.9}})});
  wide.push_back({{0}, gaussians({{1, 0.3, 1.6}}, 8)});
  const MixtureProduct q(wide), close(factors);
  RandomNumbers random(11);
  double of_mean = 0, of_deviation = 0, made = 0, made_before = 0;
  const auto error_of = [](const Eigen::MatrixXd& x, const Eigen::VectorXd& w) {
    const double mean = x.col(0).dot(w);
    return std::sqrt((x.col(0).cwiseAbs2().dot(w) - mean * mean) / 2) - 1;
  };
  for (int repeat = 0; repeat < k_repeats; ++repeat) {
    Eigen::MatrixXd points;
    Eigen::VectorXd log_q;
    q.sample(1000, random, points);
    q.log_density(points, log_q);
    const Eigen::VectorXd weights = weights_of(-points.col(0).cwiseAbs(), log_q);
    const auto found = calibrate(control_variates(close, points, log_q, {}, random), weights, points);
    ASSERT_TRUE(found);
    const double error = error_of(points, found->weights);
    of_mean += std::pow(points.col(0).dot(found->weights) / std::sqrt(2) / found->errors.mean, 2);
    of_deviation += std::pow(error / found->errors.deviation, 2);
    made += error * error;
    made_before += std::pow(error_of(points, weights), 2);
  }
  EXPECT_LT(of_mean / k_repeats, 1);
  EXPECT_LT(of_deviation / k_repeats, 1);
  EXPECT_LT(made, 0.4 * made_before);
}

}  // namespace
}  // namespace knothe::posterior
