#include "knothe/assimilation/update/sequential_update.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using likelihood::test::CurvedFunctions;
using likelihood::test::LinearFunctions;
using likelihood::test::random_model;
using likelihood::test::synthetic_data;

UpdateOptions by(posterior::Method kind, Eigen::Index samples) {
  UpdateOptions options;
  options.kind = kind;
  options.samples = samples;
  return options;
}

TEST(OtherMethods, KalmanFiltersAreExactForALinearModel) {
  // The textbook filter, in the space of the observations.
  const Eigen::Index d = 3, n = 7;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(d), n, 4, 5, 11);
  const Eigen::VectorXd std = Eigen::VectorXd::LinSpaced(n, 0.2, 0.5);
  const Eigen::MatrixXd data =
      likelihood::test::synthetic_data(*model, Eigen::Vector3d(0.3, -1.0, 2.0), std, 5);
  const std::vector<posterior::Prior> priors = {
      posterior::Prior::normal(0, 1), posterior::Prior::normal(-0.5, 2), posterior::Prior::normal(1, 0.7)};
  for (const posterior::Method kind :
       {posterior::Method::extended_kalman, posterior::Method::unscented_kalman,
        posterior::Method::ensemble_kalman}) {
    SequentialUpdate filter(model, likelihood::NoiseModel::independent(std), priors, by(kind, 10000));
    Eigen::VectorXd mean = Eigen::Vector3d(0, -0.5, 1);
    Eigen::MatrixXd covariance = Eigen::Vector3d(1, 4, 0.49).asDiagonal();
    double log_evidence = 0;
    for (std::size_t t = 0; t < model->time.size(); ++t) {
      const auto i = static_cast<Eigen::Index>(t);
      const UpdateResult& r = filter.update(t, t, data.col(i));
      const Eigen::MatrixXd h = model->space * model->core[t];
      Eigen::MatrixXd s = h * covariance * h.transpose();
      s.diagonal() += std.cwiseAbs2();
      const Eigen::VectorXd innovation = data.col(i) - model->lift.col(i) - h * mean;
      const Eigen::MatrixXd gain = covariance * h.transpose() * s.inverse();
      log_evidence -= 0.5 * (innovation.dot(s.inverse() * innovation) + std::log(s.determinant()) +
                             static_cast<double>(n) * std::log(2 * M_PI));
      mean += gain * innovation;
      covariance = (Eigen::MatrixXd::Identity(d, d) - gain * h).eval() * covariance;
      EXPECT_LT((r.mean - mean).cwiseAbs().maxCoeff(), 1e-9) << static_cast<int>(kind);
      EXPECT_LT((r.covariance - covariance).cwiseAbs().maxCoeff(), 1e-9) << static_cast<int>(kind);
      EXPECT_NEAR(r.log_evidence, log_evidence, 1e-8) << static_cast<int>(kind);
      EXPECT_LT((r.maximum_a_posteriori - mean).cwiseAbs().maxCoeff(), 1e-9);
      EXPECT_TRUE(r.trusted) << r.remark;
      EXPECT_NEAR(r.effective_sample_size, 1, 1e-6);
    }
  }
}

TEST(OtherMethods, MonteCarloAgreesWithQuadrature) {
  const Eigen::Index n = 8;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 3, 33);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.6);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.0, 1.2), std, 4);
  const std::vector<posterior::Prior> priors = {posterior::Prior::normal(0.9, 0.45),
                                                posterior::Prior::normal(1.1, 0.45)};
  SequentialUpdate grid(model, likelihood::NoiseModel::independent(std), priors,
                        by(posterior::Method::grid, 0));
  SequentialUpdate particles(model, likelihood::NoiseModel::independent(std), priors,
                             by(posterior::Method::sequential_monte_carlo, 10000));
  SequentialUpdate chain(model, likelihood::NoiseModel::independent(std), priors,
                         by(posterior::Method::markov_chain, 8000));
  for (std::size_t t = 0; t < 3; ++t) {
    const auto column = data.col(static_cast<Eigen::Index>(t));
    const UpdateResult& exact = grid.update(t, t, column);
    const UpdateResult& by_particles = particles.update(t, t, column);
    const UpdateResult& by_chain = chain.update(t, t, column);
    for (const UpdateResult* r : {&by_particles, &by_chain}) {
      for (Eigen::Index k = 0; k < 2; ++k) {
        const double s = std::sqrt(exact.covariance(k, k));
        EXPECT_NEAR(r->mean[k], exact.mean[k], 0.15 * s) << "step " << t;
        EXPECT_NEAR(std::sqrt(r->covariance(k, k)) / s, 1, 0.1) << "step " << t;
      }
      EXPECT_NEAR(r->log_evidence, exact.log_evidence, 0.15) << "step " << t;
    }
    EXPECT_TRUE(by_chain.trusted) << by_chain.remark;
    EXPECT_TRUE(by_particles.trusted) << by_particles.remark;
    EXPECT_LT(by_chain.log_evidence_error, 0.1);
  }
}

TEST(OtherMethods, AFilterSaysWhereThePosteriorIsNotItsGaussian) {
  const Eigen::Index n = 8;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, 1, 21);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.4);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.45, 0.7), std, 17);
  const std::vector<posterior::Prior> priors = {posterior::Prior::normal(0.9, 0.45),
                                                posterior::Prior::normal(1.1, 0.45)};
  SequentialUpdate filter(model, likelihood::NoiseModel::independent(std), priors,
                          by(posterior::Method::extended_kalman, 1000));
  const UpdateResult& r = filter.update(0, 0, data.col(0));
  EXPECT_FALSE(r.trusted);
  EXPECT_TRUE(r.remark.starts_with("the posterior is not the Gaussian of the filter: ")) << r.remark;
  EXPECT_THROW(filter.update(0, 0, data.col(0)), UsageError);
}

TEST(OtherMethods, LateDataAndNuisancesArePartOfEveryMethod) {
  const Eigen::Index d = 2, n = 6;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(d), n, 4, 4, 5);
  const Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.3);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(0.3, -0.6), std, 8);
  const likelihood::NoiseModel noise = likelihood::NoiseModel::independent(std).with_offsets(0.4);
  const std::vector<posterior::Prior> priors = {posterior::Prior::normal(0, 1),
                                                posterior::Prior::normal(-0.5, 2)};
  SequentialUpdate exact(model, noise, priors, by(posterior::Method::grid, 0));
  SequentialUpdate filter(model, noise, priors, by(posterior::Method::extended_kalman, 1000));
  SequentialUpdate chain(model, noise, priors, by(posterior::Method::markov_chain, 8000));
  for (const std::size_t t : {0u, 2u, 1u, 3u}) {  // the datum of step 1 is late
    for (SequentialUpdate* update : {&exact, &filter, &chain})
      update->update(t, t, data.col(static_cast<Eigen::Index>(t)));
    // Linear in the parameters: the filter is exact.
    EXPECT_LT((filter.result().mean - exact.result().mean).cwiseAbs().maxCoeff(), 1e-5);
    EXPECT_NEAR(filter.result().log_evidence, exact.result().log_evidence, 1e-5);
    EXPECT_NEAR(chain.result().log_evidence, exact.result().log_evidence, 0.1);
  }
}

}  // namespace
}  // namespace knothe::assimilation
