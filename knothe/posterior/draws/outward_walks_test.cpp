#include "knothe/posterior/draws/outward_walks.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/posterior/testing/known_mixture.hpp"
#include "knothe/posterior/testing/test_targets.hpp"
#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior {
namespace {

/// Independent draws of a target known to its constant, those beyond a border left out: what importance
/// sampling has that never got there.
struct CutDraws {
  Eigen::MatrixXd points;
  Eigen::VectorXd weights;
  explicit CutDraws(Eigen::MatrixXd all, const std::function<bool(const Eigen::RowVectorXd&)>& is_kept) {
    std::vector<Eigen::Index> kept;
    for (Eigen::Index i = 0; i < all.rows(); ++i)
      if (is_kept(all.row(i))) kept.push_back(i);
    points = all(kept, Eigen::all);
    weights = Eigen::VectorXd::Constant(points.rows(), 1.0 / points.rows());
  }
};

/// The draws came from the target itself where `is_kept`, and from e⁻³⁰ of it beyond.
MassBeyond look(LogDensity& user, const CutDraws& draws,
                const std::function<bool(const Eigen::RowVectorXd&)>& is_kept, std::uint64_t seed,
                const Eigen::MatrixXd& more_starts = {}) {
  CheckedDensity target(user);
  const double log_n = std::log(draws.points.rows());
  return walk_outwards(target,
                       {draws.points,
                        draws.points,
                        draws.weights,
                        [&](const Eigen::MatrixXd& z, const Eigen::VectorXd&) {
                          Eigen::VectorXd log_weight(z.rows());
                          for (Eigen::Index i = 0; i < z.rows(); ++i)
                            log_weight[i] = (is_kept(z.row(i)) ? 0 : 30) - log_n;
                          return log_weight;
                        },
                        {},
                        more_starts},
                       {.seed = seed});
}

TEST(OutwardWalks, DrawsOfTheTargetItselfLeaveNothing) {
  const auto all = [](const Eigen::RowVectorXd&) { return true; };
  for (const Eigen::Index d : {1, 3, 8}) {
    targets::Gaussian gaussian(Eigen::VectorXd::Zero(d), Eigen::MatrixXd::Identity(d, d));
    for (std::uint64_t seed = 1; seed <= 5; ++seed)
      EXPECT_FALSE(look(gaussian, CutDraws(RandomNumbers(seed).normals(2000, d), all), all, seed).found());
  }
}

TEST(OutwardWalks, WhatWasCutOffIsFound) {
  const auto below = [](const Eigen::RowVectorXd& z) { return z[0] < 1.5; };
  for (const Eigen::Index d : {1, 3, 8})
    for (const int derivatives : {0, 2}) {
      targets::Gaussian gaussian(Eigen::VectorXd::Zero(d), Eigen::MatrixXd::Identity(d, d));
      gaussian.derivatives = derivatives;
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        const MassBeyond beyond =
            look(gaussian, CutDraws(RandomNumbers(seed).normals(2000, d), below), below, seed);
        ASSERT_TRUE(beyond.found()) << d << " " << derivatives << " " << seed;
        for (const MixtureComponent& place : beyond.places) EXPECT_GE(place.centre[0], 1.5);
      }
    }
}

/// 100:1, the arms cut off at two deviations: walks follow the ridge.
TEST(OutwardWalks, TheArmsOfANarrowBananaAreFound) {
  const auto inner = [](const Eigen::RowVectorXd& z) { return std::abs(z[0]) < 2; };
  targets::Planar banana(targets::banana(1, 0, 0.02));
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Eigen::MatrixXd all = RandomNumbers(seed).normals(3000, 2);
    all.col(1) = all.col(0).cwiseAbs2() + 0.02 * all.col(1);
    EXPECT_TRUE(look(banana, CutDraws(all, inner), inner, seed).found()) << seed;
  }
}

/// x_k ~ N(0, e^v), v ~ N(0, 3²), cut off below v = −3: walks go down into a neck of a hundredth of the
/// width.
TEST(OutwardWalks, TheNeckOfAFunnelIsFound) {
  struct Funnel : LogDensity {
    [[nodiscard]] Eigen::Index dimension() const override { return 5; }
    [[nodiscard]] int available_derivatives() const override { return 0; }
    void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int, LogDensityBatch& out) override {
      for (Eigen::Index i = 0; i < z.rows(); ++i)
        out.value[i] =
            -z(i, 0) * z(i, 0) / 18 - 0.5 * z.row(i).tail(4).squaredNorm() * std::exp(-z(i, 0)) - 2 * z(i, 0);
    }
  } funnel;
  const auto mouth = [](const Eigen::RowVectorXd& z) { return z[0] > -3; };
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Eigen::MatrixXd all = RandomNumbers(seed).normals(3000, 5);
    all.col(0) *= 3;
    for (Eigen::Index k = 1; k < 5; ++k) all.col(k).array() *= (0.5 * all.col(0).array()).exp();
    EXPECT_TRUE(look(funnel, CutDraws(all, mouth), mouth, seed).found()) << seed;
  }
}

/// ½ N(−2, I/16) + ½ N(2, I/16), and draws of the first mode alone: walks from these never come to the other,
/// one that begins between both may.
TEST(OutwardWalks, AModeWithoutDrawsIsFoundFromBetween) {
  const Eigen::Index d = 8;
  const Eigen::VectorXd centre = Eigen::VectorXd::Constant(d, 2);
  const Eigen::MatrixXd lower = 0.25 * Eigen::MatrixXd::Identity(d, d);
  targets::KnownMixture target({{0.5, -centre, lower}, {0.5, centre, lower}}, 0);
  const auto first = [](const Eigen::RowVectorXd& z) { return z.sum() < 0; };
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Eigen::MatrixXd draws = (0.25 * RandomNumbers(seed).normals(2000, d)).array() - 2;
    EXPECT_FALSE(look(target, CutDraws(draws, first), first, seed).found()) << seed;
    const Eigen::MatrixXd between = Eigen::MatrixXd::Constant(1, d, 0.1);
    const MassBeyond beyond = look(target, CutDraws(draws, first), first, seed, between);
    ASSERT_TRUE(beyond.found()) << seed;
    for (const MixtureComponent& place : beyond.places) EXPECT_GT(place.centre.sum(), 0);
  }
}

/// Quantiles of Pareto's distribution, (1 − u)⁻ᵏ, to one side; a Gaussian's tail is light, what is bounded
/// has none.
TEST(TailShape, IsThatOfTheDistribution) {
  const Eigen::Index n = 100'000;
  const Eigen::VectorXd weights = Eigen::VectorXd::Constant(n, 1.0 / n);
  Eigen::MatrixXd x(n, 2);
  for (const double k : {0.5, 1.0}) {
    for (Eigen::Index i = 0; i < n; ++i) x.row(i) << std::pow(1 - (i + 0.5) / n, -k), -1.0 * i;
    EXPECT_NEAR(tail_shape_of(x, weights), k, 0.2 * k) << k;
    EXPECT_EQ(tail_shape_of(-x, weights), tail_shape_of(x, weights));
  }
  EXPECT_LT(tail_shape_of(x.col(1), weights), 0.01);
  EXPECT_LT(tail_shape_of(RandomNumbers(3).normals(n, 1), weights), 0.2);
}

}  // namespace
}  // namespace knothe::posterior
