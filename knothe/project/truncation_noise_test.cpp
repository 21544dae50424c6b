#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/testing/test_models.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::project {
namespace {

using assimilation::SequentialUpdate;
using likelihood::GaussianNoise;
using likelihood::NoiseModel;

/// The posterior with the model's error as an error of each step, against that with the dense sum of the
/// covariances, R + F Fᵀ + diag(left out), step by step.
TEST(TruncationNoise, IsTheDenseSumOfTheCovariances) {
  constexpr Eigen::Index n = 7, times = 4;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(2), n, 4, times, 21);
  const std::vector<posterior::Prior> priors = {posterior::Prior::normal(0, 1),
                                                posterior::Prior::normal(-0.5, 2)};
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  model::ObservedTruncation error{{}, Eigen::MatrixXd(n, times)};
  for (Eigen::Index t = 0; t < times; ++t) {
    error.factors.emplace_back(Eigen::MatrixXd::NullaryExpr(n, 2, [&] { return 0.3 * normal(random); }));
    for (double& variance : error.left_out.col(t)) variance = 0.01 * std::abs(normal(random));
  }
  const Eigen::VectorXd std = Eigen::VectorXd::LinSpaced(n, 0.2, 0.5);
  Eigen::MatrixXd precision = Eigen::MatrixXd::Identity(n, n) * 20;
  for (Eigen::Index i = 1; i < n; ++i) precision(i, i - 1) = precision(i - 1, i) = 6;
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(0.3, -0.6), std, 8);
  for (const GaussianNoise& noise :
       {GaussianNoise::independent(std), GaussianNoise::correlated(precision.sparseView())}) {
    NoiseModel dense = noise;
    for (Eigen::Index t = 0; t < times; ++t) {
      Eigen::MatrixXd sum =
          Eigen::MatrixXd(noise.precision()).inverse() + error.factors[t] * error.factors[t].transpose();
      sum.diagonal() += error.left_out.col(t);
      dense = dense.with_step(t, GaussianNoise::of_covariance(0.5 * (sum + sum.transpose())));
    }
    assimilation::UpdateOptions grid;
    grid.kind = posterior::Method::grid;
    SequentialUpdate summed(model, dense, priors, grid);
    SequentialUpdate composed(model, with_truncation(noise, error), priors, grid);
    for (std::size_t t = 0; t < times; ++t) {
      const auto column = data.col(static_cast<Eigen::Index>(t));
      const auto& expected = summed.update(t, t, column);
      const auto& found = composed.update(t, t, column);
      EXPECT_LT((found.mean - expected.mean).norm(), 1e-9);
      EXPECT_LT((found.covariance - expected.covariance).norm(), 1e-9);
      EXPECT_NEAR(found.log_evidence, expected.log_evidence, 1e-8);
    }
  }
}

}  // namespace
}  // namespace knothe::project
