#include "knothe/assimilation/update/posterior_shift.hpp"

#include <gtest/gtest.h>

#include <random>

#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index k_times = 10, k_sensors = 6;
constexpr double k_std = 0.3;

/// y_t = A_t p of d parameters: with priors N(0, 1) the posterior is Gaussian, and known.
std::shared_ptr<model::ObservedModel> linear_model(Index d, double change) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  auto model = std::make_shared<model::ObservedModel>();
  model->functions = std::make_shared<likelihood::test::LinearFunctions>(d);
  for (Index k = 0; k < d; ++k) model->parameters.push_back("p" + std::to_string(k));
  model->space = MatrixXd::Identity(k_sensors, k_sensors);
  model->lift = MatrixXd::Zero(k_sensors, k_times);
  for (Index t = 0; t < k_times; ++t) {
    model->time.push_back(static_cast<double>(t));
    MatrixXd a(k_sensors, d);
    for (double& entry : a.reshaped()) entry = 0.5 * normal(random) + change * normal(random);
    model->core.push_back(a);
  }
  return model;
}

struct Gaussian {
  VectorXd mean;
  MatrixXd covariance;
};

/// Of the data up to `step`.
Gaussian exact_posterior(const model::ObservedModel& model, const MatrixXd& data, std::size_t step) {
  const Index d = model.core[0].cols();
  MatrixXd precision = MatrixXd::Identity(d, d);
  VectorXd pull = VectorXd::Zero(d);
  for (std::size_t t = 0; t <= step; ++t) {
    precision += model.core[t].transpose() * model.core[t] / (k_std * k_std);
    pull += model.core[t].transpose() * data.col(static_cast<Index>(t)) / (k_std * k_std);
  }
  const MatrixXd covariance = precision.inverse();
  return {covariance * pull, covariance};
}

class PosteriorShiftTest : public testing::TestWithParam<std::pair<Index, double>> {};

TEST_P(PosteriorShiftTest, IsThatOfTheExactPosteriors) {
  const auto [d, change] = GetParam();
  const auto reference = linear_model(d, 0), model = linear_model(d, change);
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  const VectorXd truth = VectorXd::LinSpaced(d, -0.8, 0.8);
  MatrixXd data(k_sensors, k_times);
  for (Index t = 0; t < k_times; ++t)
    for (Index i = 0; i < k_sensors; ++i)
      data(i, t) = reference->core[static_cast<std::size_t>(t)].row(i).dot(truth) + k_std * normal(random);
  const std::vector<posterior::Prior> priors(static_cast<std::size_t>(d), posterior::Prior::normal(0, 1));
  const auto shifts =
      posterior_shift(model, reference, data,
                      likelihood::NoiseModel::independent(VectorXd::Constant(k_sensors, k_std)), priors);
  ASSERT_EQ(shifts.size(), d > 3 ? 5u : 10u);
  EXPECT_EQ(shifts.back().step, 9u);
  for (const PosteriorShift& shift : shifts) {
    const Gaussian ours = exact_posterior(*model, data, shift.step),
                   theirs = exact_posterior(*reference, data, shift.step);
    const Eigen::ArrayXd std = theirs.covariance.diagonal().array().sqrt();
    const double mean = ((ours.mean - theirs.mean).array().abs() / std).maxCoeff();
    const double of_std = (ours.covariance.diagonal().array().sqrt() / std - 1).abs().maxCoeff();
    EXPECT_NEAR(shift.mean, mean, 0.03 + 0.05 * mean) << "step " << shift.step;
    EXPECT_NEAR(shift.std, of_std, 0.03) << "step " << shift.step;
  }
  EXPECT_EQ(summarise(shifts).last.step, 9u);
}

// A small and a large change, for which the reference's points are too few, with few parameters and with
// many.
INSTANTIATE_TEST_SUITE_P(Models, PosteriorShiftTest,
                         testing::Values(std::pair<Index, double>{2, 0.01}, std::pair<Index, double>{2, 0.3},
                                         std::pair<Index, double>{5, 0.01}, std::pair<Index, double>{5, 0.05},
                                         std::pair<Index, double>{5, 0.4}));

}  // namespace
}  // namespace knothe::assimilation
