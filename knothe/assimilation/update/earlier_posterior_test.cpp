#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/testing/test_models.hpp"
#include "knothe/posterior/prior/joint_prior.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using likelihood::NoiseModel;
using posterior::JointPrior;
using posterior::Method;

struct Way {
  Method kind;
  UpdateOptions::Form form = UpdateOptions::Form::collapsed;
  double tolerance = 1e-3;  ///< of moments, in standard deviations
};

UpdateOptions options_of(const Way& way) {
  UpdateOptions options;
  options.kind = way.kind;
  options.form = way.form;
  options.samples = 20000;
  return options;
}

std::vector<posterior::Prior> marginals(const std::shared_ptr<const JointPrior>& joint) {
  std::vector<posterior::Prior> priors;
  for (Eigen::Index k = 0; k < joint->mean().size(); ++k) priors.push_back(marginal_of(joint, k));
  return priors;
}

/// Conjugate: a correlated Gaussian prior, a linear model.
TEST(EarlierPosterior, ACorrelatedGaussianIsThatOfTheFormula) {
  constexpr Eigen::Index d = 3, n = 7;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(d), n, 4, 4, 11);
  const VectorXd std = VectorXd::LinSpaced(n, 2, 5);
  const MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector3d(0.3, -1.0, 2.0), std, 5);
  const Eigen::Vector3d mean0(0.1, -0.5, 1);
  MatrixXd lower(d, d);
  lower << 1, 0, 0, 1.4, 0.6, 0, -0.3, 0.5, 0.2;
  const auto joint = std::make_shared<const JointPrior>(
      std::vector<posterior::MixtureComponent>{{1, mean0, lower}}, "the posterior of A");
  MatrixXd precision = (lower * lower.transpose()).inverse();
  VectorXd shift = precision * mean0;
  const Eigen::Index steps = data.cols();
  MatrixXd all(n * steps, d);
  VectorXd residual(n * steps);
  for (Eigen::Index t = 0; t < steps; ++t) {
    const std::size_t at = t;
    const MatrixXd h = model->space * model->core[at];
    const MatrixXd weighted = std.cwiseAbs2().cwiseInverse().asDiagonal() * h;
    precision += h.transpose() * weighted;
    shift += weighted.transpose() * (data.col(t) - model->lift.col(t));
    all.middleRows(n * t, n) = h;
    residual.segment(n * t, n) = data.col(t) - model->lift.col(t) - h * mean0;
  }
  MatrixXd evidence = all * lower * lower.transpose() * all.transpose();
  evidence.diagonal() += std.cwiseAbs2().replicate(steps, 1);
  const Eigen::LLT<MatrixXd> factor(evidence);
  const double log_evidence = -0.5 * residual.dot(factor.solve(residual)) -
                              MatrixXd(factor.matrixL()).diagonal().array().log().sum() -
                              0.5 * n * steps * std::log(2 * M_PI);
  const MatrixXd exact = precision.inverse();
  const VectorXd mean = exact * shift, deviation = exact.diagonal().cwiseSqrt();
  for (const Way& way :
       {Way{Method::automatic}, Way{Method::transport}, Way{Method::transport, UpdateOptions::Form::composed},
        Way{Method::grid}, Way{Method::extended_kalman}, Way{Method::unscented_kalman},
        Way{Method::sequential_monte_carlo, UpdateOptions::Form::collapsed, 0.05},
        Way{Method::markov_chain, UpdateOptions::Form::collapsed, 0.1}}) {
    SCOPED_TRACE(to_text(way.kind));
    SequentialUpdate update(model, NoiseModel::independent(std), marginals(joint), options_of(way));
    const UpdateResult* r = nullptr;
    for (Eigen::Index t = 0; t < steps; ++t) r = &update.update(t, t, data.col(t));
    for (Eigen::Index a = 0; a < d; ++a) {
      EXPECT_NEAR(r->mean[a], mean[a], way.tolerance * deviation[a]);
      EXPECT_NEAR(r->covariance(a, 0), exact(a, 0), 2 * way.tolerance * deviation[a] * deviation[0]);
    }
    EXPECT_NEAR(r->log_evidence, log_evidence, std::max(1e-3, way.tolerance));
    EXPECT_LT((r->maximum_a_posteriori - mean).cwiseQuotient(deviation).cwiseAbs().maxCoeff(), 1e-6);
  }
}

/// Data in two runs, the posterior of the first as the prior of the second, are the data in one run, up to
/// what a mixture leaves of a shape. The model is curved: the first posterior is a banana.
TEST(EarlierPosterior, DataInTwoRunsAreDataInOne) {
  constexpr Eigen::Index n = 8;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 4, 33);
  const VectorXd std = VectorXd::Constant(n, 0.6);
  const std::vector<posterior::Prior> priors(2, posterior::Prior::normal(1, 0.45));
  for (const unsigned seed : {3u, 8u}) {
    const MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.0, 1.2), std, seed);
    using enum UpdateOptions::Form;
    for (const Way& way : {Way{Method::automatic, collapsed, 0.02}, Way{Method::grid, collapsed, 0.02},
                           Way{Method::transport, collapsed, 0.02}, Way{Method::transport, composed, 0.02}}) {
      SCOPED_TRACE(to_text(way.kind) + std::to_string(seed));
      const NoiseModel noise = NoiseModel::independent(std);
      SequentialUpdate one(model, noise, priors, options_of(way)),
          first(model, noise, priors, options_of(way));
      for (std::size_t t = 0; t < 4; ++t) one.update(t, t, data.col(t));
      for (std::size_t t = 0; t < 2; ++t) first.update(t, t, data.col(t));
      const UpdateResult before = first.posterior_without_monitor(1);
      const auto joint = std::make_shared<const JointPrior>(before.points, before.weights, "the first run");
      SequentialUpdate second(model, noise, marginals(joint), options_of(way));
      for (std::size_t t = 2; t < 4; ++t) second.update(t, t, data.col(t));
      const UpdateResult whole = one.posterior_without_monitor(3),
                         after = second.posterior_without_monitor(3);
      for (Eigen::Index a = 0; a < 2; ++a) {
        const double deviation = std::sqrt(whole.covariance(a, a));
        EXPECT_NEAR(after.mean[a], whole.mean[a], way.tolerance * deviation);
        EXPECT_NEAR(std::sqrt(after.covariance(a, a)), deviation, way.tolerance * deviation);
      }
      EXPECT_NEAR(before.log_evidence + after.log_evidence, whole.log_evidence, 0.03);
      EXPECT_TRUE(after.trusted) << after.remark;
    }
  }
}

}  // namespace
}  // namespace knothe::assimilation
