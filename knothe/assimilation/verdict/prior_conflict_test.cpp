#include "knothe/assimilation/verdict/prior_conflict.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <random>

#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/posterior/prior/joint_prior.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using posterior::Prior;
using posterior::PriorTransform;

std::vector<model::Axis> axes(Index d) {
  std::vector<model::Axis> named;
  for (Index a = 0; a < d; ++a) named.emplace_back().name = "abcdef"[a];
  return named;
}

/// The posterior N(mean, covariance) as weighted points.
posterior::Posterior normal_posterior(const VectorXd& mean, const MatrixXd& covariance) {
  posterior::Posterior made;
  made.mean = mean;
  made.covariance = covariance;
  const MatrixXd factor = covariance.llt().matrixL();
  made.points =
      (numerics::sobol_normal_points(512, mean.size(), 3) * factor.transpose()).rowwise() + mean.transpose();
  made.weights = VectorXd::Constant(512, 1.0 / 512);
  return made;
}

/// A conjugate linear problem: priors N(centre, width²), data that say `estimate` with covariance `error`.
struct Conjugate {
  VectorXd centre, width, estimate;
  MatrixXd error;

  [[nodiscard]] PriorTransform priors() const {
    std::vector<Prior> made;
    for (Index a = 0; a < centre.size(); ++a) made.push_back(Prior::normal(centre[a], width[a]));
    return PriorTransform(made);
  }
  [[nodiscard]] posterior::Posterior posterior() const {
    const MatrixXd information = error.inverse(), prior = width.cwiseAbs2().cwiseInverse().asDiagonal();
    const MatrixXd covariance = (information + prior).inverse();
    return normal_posterior(covariance * (information * estimate + prior * centre),
                            0.5 * (covariance + covariance.transpose()));
  }
  [[nodiscard]] PriorConflict conflict() const { return find_prior_conflict(priors(), posterior()); }
  [[nodiscard]] std::optional<VerdictReason> reason() const {
    return conflict_reason(conflict(), priors(), axes(centre.size()));
  }
};

/// Of one parameter prior and data are two measurements: their difference has the sum of the variances.
TEST(PriorConflict, OfOneParameterIsTheDifferenceOfTwoMeasurements) {
  for (const double std : {0.2, 1.0, 2.0}) {
    const Conjugate c{VectorXd::Constant(1, 10), VectorXd::Constant(1, 0.5), VectorXd::Constant(1, 13),
                      MatrixXd::Constant(1, 1, 0.25 * std * std)};
    const PriorConflict found = c.conflict();
    EXPECT_NEAR(found.distance[0], 6 / std::sqrt(1 + std * std), 0.12) << std;
    EXPECT_NEAR(found.estimate[0], 6, 0.12);
    EXPECT_NEAR(found.std[0], std, 0.05 * std);
    EXPECT_NEAR(found.pull[0], 6 * std / std::sqrt(1 + std * std), 0.15) << std;
  }
}

TEST(PriorConflict, NamesTheParameterAndWhatTheDataGive) {
  Conjugate c{Eigen::Vector2d(1, 1), Eigen::Vector2d(0.02, 0.3), Eigen::Vector2d(1.16, 1.1),
              Eigen::Vector2d(4e-4, 1e-4).asDiagonal()};
  std::vector<model::Axis> named = axes(2);
  named[0] = {"E", {}, "1", "multiple of its reference [GPa]", 210.0};
  const auto reason = conflict_reason(c.conflict(), c.priors(), named);
  ASSERT_TRUE(reason);
  EXPECT_EQ(reason->part, VerdictPart::prior);
  EXPECT_EQ(reason->level, VerdictLevel::reject);  // the answer is 5.7 standard deviations from both
  EXPECT_NEAR(reason->value, 8 / std::sqrt(2.0), 0.15);
  EXPECT_GT(reason->value, reason->limit);
  EXPECT_NE(reason->message.find("prior and data contradict each other: the prior of E, 1 ± 0.02 (210 ± 4.2 "
                                 "GPa), is 8 of its standard deviations away from what the data alone give, "
                                 "1.16 ± 0.02 (243."),
            std::string::npos)
      << reason->message;
  EXPECT_NE(reason->message.find("the answer is a compromise"), std::string::npos) << reason->message;
  // Data that outweigh the prior: the answer is theirs, the prior is wrong all the same.
  c.error = Eigen::Vector2d(1e-6, 1e-4).asDiagonal();
  ASSERT_TRUE(c.reason());
  EXPECT_EQ(c.reason()->level, VerdictLevel::caution);
  EXPECT_EQ(c.reason()->message.find("compromise"), std::string::npos);
  // Data that say nothing of it cannot contradict.
  c.error = Eigen::Vector2d(1, 1e-4).asDiagonal();
  EXPECT_FALSE(c.reason());
}

/// A model that is curved: the prior lies where the data see little, and is moved all the same.
TEST(PriorConflict, APosteriorThatHasMovedAndIsAsWideAsThePriorIsOne) {
  const PriorTransform priors({Prior::normal(0, 1)});
  const auto reason_at = [&](double mean) {
    const auto posterior = normal_posterior(VectorXd::Constant(1, mean), MatrixXd::Constant(1, 1, 1.1));
    return conflict_reason(find_prior_conflict(priors, posterior), priors, axes(1));
  };
  EXPECT_TRUE(reason_at(-2));
  EXPECT_FALSE(reason_at(0.9));
}

/// Data that know the sum of two parameters only: each prior alone could be right, not both.
TEST(PriorConflict, ParametersTakenTogetherContradictWhereNoneDoesAlone) {
  const Index d = 6;
  Conjugate c{VectorXd::Zero(d), VectorXd::Ones(d), VectorXd::Constant(d, 1.9),
              MatrixXd::Identity(d, d) * 1e-4};
  EXPECT_LT(c.conflict().distance.maxCoeff(), 2);
  EXPECT_NEAR(c.conflict().probability, 1.2e-3, 4e-4);  // χ² of 6 degrees beyond 6 · 1.9²
  EXPECT_FALSE(c.reason());
  c.estimate = VectorXd::Constant(d, 2.3);
  ASSERT_TRUE(c.reason());
  EXPECT_EQ(c.reason()->message.find("taken together, prior and data contradict each other"), 0u);
}

/// Truths drawn from the prior, data of every kind: sharp, weak, of some directions only.
TEST(PriorConflict, ContradictsByChanceAsRarelyAsStated) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  const auto draw = [&](Index rows, Index columns) -> MatrixXd {
    return MatrixXd::NullaryExpr(rows, columns, [&](Index, Index) { return normal(random); });
  };
  const Index d = 3;
  int alarms = 0, of_sharp_data = 0, below_tenth = 0;
  for (int k = 0; k < 2000; ++k) {
    const double noise = std::pow(10.0, -2.0 + 2.5 * (k % 10) / 9.0);
    const MatrixXd observed = draw(d + 1, d);
    const MatrixXd error = noise * noise * (observed.transpose() * observed).inverse();
    const VectorXd truth = draw(d, 1);
    const MatrixXd factor = error.llt().matrixL();
    const Conjugate c{VectorXd::Zero(d), VectorXd::Ones(d), truth + factor * draw(d, 1),
                      0.5 * (error + error.transpose())};
    const bool alarm = c.reason().has_value();
    alarms += alarm ? 1 : 0;
    of_sharp_data += alarm && k % 10 < 3 ? 1 : 0;
    below_tenth += c.conflict().probability < 0.1 ? 1 : 0;
  }
  EXPECT_LE(alarms, 30);        // 1.5 % where the prior matters, 0.1 % elsewhere
  EXPECT_LE(of_sharp_data, 3);  // of 600
  EXPECT_GT(below_tenth, 100);  // 10 % where all directions count
  EXPECT_LT(below_tenth, 250);
}

/// p(z) of a truncated prior is far from linear at an end of the box.
TEST(PriorConflict, OfATruncatedPriorIsCalibratedAtTheEndsOfTheBox) {
  const Prior prior = Prior::normal(0.9, 0.4472135954999579).truncated(0.5, 1.5, "Y0");
  const PriorTransform priors({prior});
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  int alarms = 0;
  for (int k = 0; k < 1000; ++k) {
    const double std = std::pow(10.0, -2.5 + 2.0 * (k % 10) / 9.0);
    const double seen = prior.from_standard_normal(normal(random)).value + std * normal(random);
    posterior::Posterior made;
    made.points.resize(2001, 1);
    made.weights.resize(2001);
    for (Index i = 0; i <= 2000; ++i) {
      const double p = 0.5 + i / 2000.0;
      made.points(i, 0) = p;
      made.weights[i] = std::exp(prior.log_density(p) - 0.5 * std::pow((p - seen) / std, 2));
    }
    made.weights[0] *= 0.5, made.weights[2000] *= 0.5;
    made.weights /= made.weights.sum();
    made.summarise();
    alarms += conflict_reason(find_prior_conflict(priors, made), priors, axes(1)) ? 1 : 0;
  }
  EXPECT_LE(alarms, 8);
}

/// A displacement fixes the ratio of a stiffness, known to 10 %, and a strength that is hardly known: the
/// stiffness keeps its prior, and the strength's own error is the stiffness'.
TEST(PriorConflict, ParametersOfWhichOnlyARatioIsSeenCannotBeToldApart) {
  const Eigen::Vector3d width(0.45, 0.45, 0.1);
  Eigen::Matrix<double, 2, 3> seen;  // first + third, second - third
  seen << 1, 0, 1, 0, 1, -1;
  const auto posterior_of = [&](double noise, double force_noise) {
    Eigen::Matrix3d information = seen.transpose() * seen / (noise * noise);
    information(2, 2) += 1 / (force_noise * force_noise);
    const MatrixXd prior = width.cwiseAbs2().cwiseInverse().asDiagonal();
    return normal_posterior(VectorXd::Ones(3), (information + prior).inverse());
  };
  const Conjugate c{VectorXd::Ones(3), width, {}, {}};
  std::vector<model::Axis> named = axes(3);
  named[2].name = "E";
  const auto reason_for = [&](double noise, double force_noise) {
    return not_told_apart(find_prior_conflict(c.priors(), posterior_of(noise, force_noise)), c.priors(),
                          named);
  };
  const auto reason = reason_for(0.003, 1e3);
  ASSERT_TRUE(reason);
  EXPECT_EQ(
      reason->message,
      "E cannot be told apart from a, b: the data determine a combination of them and leave E 95 % of the "
      "standard deviation of its prior, which decides the rest: add a sensor that tells them apart (a force "
      "beside displacements), or give E as known");
  EXPECT_EQ(reason->level, VerdictLevel::caution);
  EXPECT_GT(reason->value, reason->limit);
  EXPECT_LT(reason->value, 1);
  EXPECT_FALSE(reason_for(0.003, 0.03));  // with a force
  EXPECT_FALSE(reason_for(1.0, 1e3));     // data that say little of anything
}

/// What a joint prior knows of two parameters is no fault of the data.
TEST(PriorConflict, CorrelationOfAJointPriorDoesNotCount) {
  Eigen::Matrix2d covariance;
  covariance << 1, 0.99, 0.99, 1;
  const auto joint = std::make_shared<const posterior::JointPrior>(
      std::vector<posterior::MixtureComponent>{
          {1, Eigen::Vector2d::Zero(), Eigen::MatrixXd(covariance.llt().matrixL())}},
      "the posterior of an earlier test");
  const PriorTransform together({marginal_of(joint, 0), marginal_of(joint, 1)});
  const PriorTransform separate({Prior::normal(0, 1), Prior::normal(0, 1)});
  const auto reason_with = [&](const PriorTransform& priors) {
    const auto posterior = normal_posterior(Eigen::Vector2d::Zero(), covariance);
    return not_told_apart(find_prior_conflict(priors, posterior), priors, axes(2));
  };
  EXPECT_TRUE(reason_with(separate));
  EXPECT_FALSE(reason_with(together));
}

}  // namespace
}  // namespace knothe::assimilation
