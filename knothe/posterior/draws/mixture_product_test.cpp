#include "knothe/posterior/draws/mixture_product.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"

namespace knothe::posterior {
namespace {

using Groups = std::vector<std::vector<Eigen::Index>>;

MixtureComponent component(double weight, const Eigen::VectorXd& centre, double scale) {
  const Eigen::Index d = centre.size();
  return {weight, centre, scale * Eigen::MatrixXd::Identity(d, d)};
}

/// Coordinates 0 and 2: two modes; coordinate 1: one, with heavy tails.
MixtureProduct two_factors() {
  std::vector<MixtureProduct::Factor> factors;
  factors.push_back(
      {{2, 0},
       Mixture({component(0.7, Eigen::Vector2d(3, -1), 0.5), component(0.3, Eigen::Vector2d(-3, 1), 0.2)})});
  factors.push_back({{1}, Mixture({component(1, Eigen::VectorXd::Constant(1, 10), 2)}, 4)});
  return MixtureProduct(std::move(factors));
}

double normal(double x, double centre, double scale) {
  return std::exp(-0.5 * std::pow((x - centre) / scale, 2)) / (scale * std::sqrt(2 * std::numbers::pi));
}

TEST(MixtureProduct, DensityIsTheProductOfTheFactors) {
  const MixtureProduct q = two_factors();
  Eigen::MatrixXd points(2, 3);
  points << -0.8, 11.0, 2.7, 1.1, 7.0, -3.1;
  Eigen::VectorXd found;
  q.log_density(points, found);
  for (Eigen::Index i = 0; i < 2; ++i) {
    const double x0 = points(i, 0), x1 = points(i, 1), x2 = points(i, 2);
    const double pair =
        0.7 * normal(x2, 3, 0.5) * normal(x0, -1, 0.5) + 0.3 * normal(x2, -3, 0.2) * normal(x0, 1, 0.2);
    const double y = (x1 - 10) / 2, student = 0.375 * std::pow(1 + y * y / 4, -2.5) / 2;
    EXPECT_NEAR(found[i], std::log(pair * student), 1e-12);
  }
}

TEST(MixtureProduct, DrawsOfTheFactorsAreIndependent) {
  const MixtureProduct q = two_factors();
  RandomNumbers random(3);
  Eigen::MatrixXd points;
  q.sample(20000, random, points);
  ASSERT_EQ(points.cols(), 3);
  EXPECT_NEAR((points.col(2).array() > 0).cast<double>().mean(), 0.7, 1e-4);  // stratified
  EXPECT_NEAR(points.col(1).mean(), 10, 0.1);
  // Above and below the middle of one coordinate, another one has the same share of its mode.
  const auto above = (points.col(1).array() > 10).cast<double>(),
             right = (points.col(2).array() > 0).cast<double>();
  EXPECT_NEAR((above * right).mean(), above.mean() * right.mean(), 0.01);
  EXPECT_EQ(dependent_groups({points}), (Groups{{0, 2}, {1}}));
}

TEST(MixtureProduct, CoordinatesThatAreNotEachInOneFactorAreRefused) {
  const Mixture one({component(1, Eigen::VectorXd::Zero(1), 1)});
  EXPECT_THROW(MixtureProduct({{{0}, one}, {{0}, one}}), UsageError);
  EXPECT_THROW(MixtureProduct({{{0}, one}, {{2}, one}}), UsageError);
  EXPECT_THROW(MixtureProduct({{{0, 1}, one}}), UsageError);
}

TEST(DependentGroups, ARingHasNoCorrelationAndIsOneGroup) {
  RandomNumbers random(5);
  Eigen::MatrixXd points(800, 4);
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    const double angle = 2 * std::numbers::pi * random.uniform();
    points.row(i) << std::cos(angle), random.normal(), std::sin(angle), random.normal();
  }
  EXPECT_EQ(dependent_groups({points}), (Groups{{0, 2}, {1}, {3}}));
  // A chain of neighbours is one group, also where its ends hardly depend on each other.
  points.col(1) = points.col(0) + 0.3 * points.col(3);
  EXPECT_EQ(dependent_groups({points}), (Groups{{0, 1, 2, 3}}));
}

TEST(DependentGroups, OneSampleThatShowsItIsEnough) {
  RandomNumbers random(6);
  Eigen::MatrixXd apart(800, 2), together(800, 2);
  for (Eigen::Index i = 0; i < apart.rows(); ++i) {
    apart.row(i) << random.normal(), random.normal();
    const double x = random.normal();
    together.row(i) << x, x + 0.5 * random.normal();
  }
  EXPECT_EQ(dependent_groups({apart}), (Groups{{0}, {1}}));
  EXPECT_EQ(dependent_groups({apart, together}), (Groups{{0, 1}}));
}

TEST(DependentGroups, OfFewPointsAreNotMadeByChance) {
  const Eigen::MatrixXd few = RandomNumbers(2).normals(30, 6), many = few.replicate(30, 1);
  EXPECT_LT(dependent_groups({many}).size(), 6U);
  EXPECT_EQ(dependent_groups({many}, 30).size(), 6U);
  Eigen::MatrixXd line = many;
  line.col(4) = line.col(1);
  EXPECT_EQ(dependent_groups({line}, 30).size(), 5U);
}

/// Two coordinates in one factor, one of them with both ends, and one alone with a lower end.
TEST(MixtureProduct, WhatIsMirroredAtEndsHasTheDensityOfItsDraws) {
  std::vector<MixtureProduct::Factor> factors;
  factors.push_back(
      {{0, 1},
       Mixture({component(0.6, Eigen::Vector2d(0.2, -1), 0.5), component(0.4, Eigen::Vector2d(0.9, 1), 0.3)},
               8)});
  factors.push_back({{2}, Mixture({component(1, Eigen::VectorXd::Constant(1, 0.5), 1)})});
  SupportEnds ends = SupportEnds::none(3);
  ends.lower[0] = 0, ends.upper[0] = 1, ends.lower[2] = 0;
  const MixtureProduct q(std::move(factors), ends);
  RandomNumbers random(5);
  Eigen::MatrixXd drawn;
  q.sample(40000, random, drawn);
  const auto in_box = [](const auto& x) {
    return x.col(0).array() > 0.1 && x.col(0).array() < 0.5 && x.col(1).array() > -1.5 &&
           x.col(1).array() < 0 && x.col(2).array() > 0 && x.col(2).array() < 1;
  };
  // The density's integral over a box is the share of the draws there; that over all space is 1.
  const Eigen::Index n = 200000;
  Eigen::MatrixXd even(n, 3);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < 3; ++k) even(i, k) = -8 + 16 * random.uniform();
  Eigen::MatrixXd inside = even;
  inside.col(0) = (0.1 + 0.4 * (even.col(0).array() + 8) / 16).matrix();
  inside.col(1) = (-1.5 + 1.5 * (even.col(1).array() + 8) / 16).matrix();
  inside.col(2) = ((even.col(2).array() + 8) / 16).matrix();
  Eigen::VectorXd log_density;
  q.log_density(inside, log_density);
  EXPECT_NEAR(0.4 * 1.5 * log_density.array().exp().mean(), in_box(drawn).cast<double>().mean(), 0.008);
  q.log_density(even, log_density);
  EXPECT_NEAR(std::pow(16, 3) * log_density.array().exp().mean(), 1, 0.05);
  // One draw in twenty is left beyond the ends, if it is there.
  EXPECT_NEAR((drawn.col(2).array() < 0).cast<double>().mean(), 0.05 * 0.3085, 0.003);
}

}  // namespace
}  // namespace knothe::posterior
