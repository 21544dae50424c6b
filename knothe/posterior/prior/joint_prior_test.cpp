#include "knothe/posterior/prior/joint_prior.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/posterior/prior/prior_transform.hpp"
#include "knothe/posterior/prior/prior_values.hpp"

namespace knothe::posterior {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

MatrixXd factor(double a, double b, double c) {
  MatrixXd lower(2, 2);
  lower << a, 0, b, c;
  return lower;
}

std::shared_ptr<const JointPrior> banana() {
  return std::make_shared<const JointPrior>(
      std::vector<MixtureComponent>{{0.6, Vector2d(1.0, 0.5), factor(0.1, 0.08, 0.03)},
                                    {0.4, Vector2d(1.15, 0.7), factor(0.06, 0.07, 0.05)}},
      "the posterior of A");
}

/// A prior of three parameters, of which the first and the last belong together, in the other order.
PriorTransform with_another(double lower, double upper) {
  const auto joint = banana();
  return PriorTransform({marginal_of(joint, 1).truncated(lower, upper, "b"), Prior::lognormal(0, 0.25),
                         marginal_of(joint, 0).truncated(lower, upper, "a")});
}

double density_of_formula(const Vector2d& x) {
  double sum = 0;
  const auto joint = banana();
  for (const MixtureComponent& c : joint->components()) {
    const VectorXd y = c.lower.triangularView<Eigen::Lower>().solve(x - c.centre);
    sum += c.weight / (2 * M_PI * c.lower.diagonal().prod()) * std::exp(-0.5 * y.squaredNorm());
  }
  return sum;
}

TEST(JointPrior, TheDensityIsThatOfTheMixtureAndOfTheOthers) {
  const PriorTransform prior = with_another(-10, 10);
  const MatrixXd p = (MatrixXd(3, 3) << 0.5, 1.1, 1.0, 0.62, 0.8, 1.2, 0.9, 1.3, 0.9).finished();
  LogDensityBatch out;
  out.resize(3, 3, 0);
  out.value.setConstant(2);
  prior.add_log_density(p, 0, out);
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(
        out.value[i],
        2 + std::log(density_of_formula({p(i, 2), p(i, 0)})) + Prior::lognormal(0, 0.25).log_density(p(i, 1)),
        1e-10);
}

TEST(JointPrior, DerivativesAreThoseOfDifferences) {
  const PriorTransform prior = with_another(0.2, 1.6);
  const MatrixXd p = (MatrixXd(1, 3) << 0.55, 1.1, 1.03).finished();
  const auto at = [&](const MatrixXd& x, int derivatives) {
    LogDensityBatch out;
    out.resize(1, 3, derivatives);
    out.value.setZero();
    if (derivatives >= 1) out.gradient.setZero();
    if (derivatives >= 2) out.hessian.setZero();
    prior.add_log_density(x, derivatives, out);
    return out;
  };
  const LogDensityBatch exact = at(p, 2);
  constexpr double h = 1e-5;
  for (int a = 0; a < 3; ++a) {
    MatrixXd above = p, below = p;
    above(0, a) += h, below(0, a) -= h;
    const LogDensityBatch up = at(above, 1), down = at(below, 1);
    EXPECT_NEAR(exact.gradient(0, a), (up.value[0] - down.value[0]) / (2 * h),
                1e-6 * (1 + std::abs(exact.gradient(0, a))));
    for (int b = 0; b <= a; ++b)
      EXPECT_NEAR(exact.hessian(0, packed_index(a, b)), (up.gradient(0, b) - down.gradient(0, b)) / (2 * h),
                  1e-3);
  }
}

/// ∫ over the box by Simpson's rule, where a tenth of the mixture is outside.
TEST(JointPrior, ItIsNormalisedInTheSupport) {
  const auto joint = banana();
  const PriorTransform prior(
      {marginal_of(joint, 0).truncated(0.9, 1.2, "a"), marginal_of(joint, 1).truncated(0.4, 0.8, "b")});
  constexpr int n = 400;
  double mass = 0;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j) {
      LogDensityBatch out;
      out.value = VectorXd::Zero(1);
      prior.add_log_density((MatrixXd(1, 2) << 0.9 + 0.3 * i / n, 0.4 + 0.4 * j / n).finished(), 0, out);
      const auto weight = [](int k) { return (k == 0 || k == n ? 1 : k % 2 ? 4 : 2) / 3.0; };
      mass += weight(i) * weight(j) * std::exp(out.value[0]);
    }
  EXPECT_NEAR(mass * 0.3 * 0.4 / n / n, 1, 0.02);  // its mass inside is by 20,000 draws
}

TEST(JointPrior, PointsHaveItsMomentsAndStayInside) {
  const PriorTransform prior = with_another(-10, 10);
  RandomNumbers random(5);
  MatrixXd normal(40000, 3);
  for (double& x : normal.reshaped()) x = random.normal();
  const MatrixXd points = prior.points(normal);
  const MatrixXd pair = (MatrixXd(points.rows(), 2) << points.col(2), points.col(0)).finished();
  const VectorXd mean = pair.colwise().mean();
  const MatrixXd centred = pair.rowwise() - mean.transpose();
  const MatrixXd covariance = centred.transpose() * centred / points.rows();
  const auto joint = banana();
  for (int a = 0; a < 2; ++a) {
    EXPECT_NEAR(mean[a], joint->mean()[a], 0.02 * std::sqrt(joint->covariance()(a, a)));
    for (int b = 0; b < 2; ++b)
      EXPECT_NEAR(covariance(a, b), joint->covariance()(a, b),
                  0.02 * std::sqrt(joint->covariance()(a, a) * joint->covariance()(b, b)));
  }
  EXPECT_NEAR(prior.covariance()(0, 2), covariance(0, 1) / std::sqrt(covariance(0, 0) * covariance(1, 1)),
              0.01);
  EXPECT_EQ(prior.covariance()(0, 1), 0);
  const MatrixXd inside = with_another(0.4, 1.1).points(normal.topRows(2000));
  EXPECT_GE(inside.minCoeff(), 0.0);
  EXPECT_TRUE((inside.col(0).array() >= 0.4 && inside.col(0).array() <= 1.1).all());
  EXPECT_TRUE((inside.col(2).array() >= 0.4 && inside.col(2).array() <= 1.1).all());
}

TEST(PriorValues, SumToTheDensityOfTheWholePrior) {
  const auto joint = banana();
  const std::vector<Prior> priors = {marginal_of(joint, 0), Prior::lognormal(0.2, 0.25),
                                     marginal_of(joint, 1)};
  const MatrixXd points{{1.0, 1.1, 0.55}, {1.2, 0.7, 0.7}};
  const PriorValues values = prior_values(priors, points);
  LogDensityBatch whole;
  whole.value.setZero(2);
  PriorTransform(priors).add_log_density(points, 0, whole);
  for (Eigen::Index i = 0; i < 2; ++i)
    EXPECT_NEAR(values.log_density.row(i).sum() + values.log_dependence[i], whole.value[i], 1e-12);
  EXPECT_EQ(values.families[1], Prior::Family::lognormal);
  EXPECT_EQ(values.mean[1], 0.2);
  EXPECT_EQ(values.std[1], 0.25);
}

TEST(PriorValues, AreFiniteAtTheEndOfTheSupportAndSayTheFamilysMoments) {
  const std::vector<Prior> priors = {Prior::uniform(-1, 5).truncated(0, 1, "a"), Prior::lognormal(0, 1)};
  const PriorValues values = prior_values(priors, MatrixXd{{2.0, 0.0}});
  EXPECT_EQ(values.log_density, (MatrixXd{{-1e6, -1e6}}));
  EXPECT_EQ(values.log_dependence.size(), 0);
  EXPECT_EQ(values.mean[0], 2);  // before truncation
  EXPECT_NEAR(values.std[0], std::sqrt(3.0), 1e-12);
}

TEST(JointPrior, SaysWhereItComesFrom) {
  EXPECT_EQ(marginal_of(banana(), 0).describe().find("normal(1.06, 0.1"), 0u);
  EXPECT_NE(marginal_of(banana(), 0).describe().find(", of the posterior of A"), std::string::npos);
}

}  // namespace
}  // namespace knothe::posterior
