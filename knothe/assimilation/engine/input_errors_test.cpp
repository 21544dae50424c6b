#include "knothe/assimilation/engine/input_errors.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <random>

#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using likelihood::NoiseModel;

constexpr Index k_sensors = 6, k_times = 8;
constexpr double k_std = 0.2, k_prior_std = 0.5;

/// A linear model, its data, and the exact posterior of any data of it under N(1, 0.5²) priors.
struct LinearTest {
  Problem problem;
  Eigen::MatrixXd data;
  Eigen::VectorXd mean;

  explicit LinearTest(double offset_std = 0) {
    auto model = std::make_shared<model::ObservedModel>(*likelihood::test::random_model(
        std::make_shared<likelihood::test::LinearFunctions>(2), k_sensors, 3, k_times, 5));
    for (std::size_t t = 0; t < k_times; ++t) model->time[t] = 0.5 + t;
    problem.model = model;
    problem.noise = NoiseModel::independent(Eigen::VectorXd::Constant(k_sensors, k_std));
    if (offset_std > 0) problem.noise = problem.noise.with_offsets(offset_std);
    problem.priors = {posterior::Prior::normal(1, k_prior_std), posterior::Prior::normal(1, k_prior_std)};
    data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.2, 0.9),
                                            Eigen::VectorXd::Constant(k_sensors, k_std), 3);
    const Index n = k_sensors * k_times;
    jacobian_.resize(n, 2);
    for (Index t = 0; t < k_times; ++t) jacobian_.middleRows(t * k_sensors, k_sensors) = slope(t);
    noise_ = k_std * k_std * Eigen::MatrixXd::Identity(n, n);
    for (Index i = 0; i < n; ++i)
      for (Index j = i % k_sensors; j < n; j += k_sensors) noise_(i, j) += offset_std * offset_std;
    mean = exact_mean(data);
  }

  [[nodiscard]] Eigen::MatrixXd slope(std::size_t t) const {
    return problem.model->space * problem.model->core[t];
  }

  /// By the covariance of all data at once.
  [[nodiscard]] Eigen::VectorXd exact_mean(const Eigen::MatrixXd& values) const {
    const Eigen::MatrixXd weighted = noise_.llt().solve(jacobian_);
    const Eigen::MatrixXd precision =
        weighted.transpose() * jacobian_ + Eigen::MatrixXd::Identity(2, 2) / (k_prior_std * k_prior_std);
    return Eigen::Vector2d::Ones() + precision.llt().solve(weighted.transpose() * left(values));
  }

  /// But for a constant.
  [[nodiscard]] double exact_log_evidence(const Eigen::MatrixXd& values) const {
    const Eigen::MatrixXd covariance = noise_ + k_prior_std * k_prior_std * jacobian_ * jacobian_.transpose();
    return -0.5 * left(values).dot(covariance.llt().solve(left(values)));
  }

  [[nodiscard]] InputShift shift(const InputError& error) const {
    std::vector<likelihood::DatumPointer> pointers;
    for (Index t = 0; t < k_times; ++t) pointers.push_back(likelihood::test::datum(t, data.col(t)));
    return shifts_by(std::span(&error, 1), problem, pointers, mean).at(0);
  }

 private:
  /// What the model leaves of the data at the prior's mean.
  [[nodiscard]] Eigen::VectorXd left(const Eigen::MatrixXd& values) const {
    return (values - problem.model->lift).reshaped() - jacobian_ * Eigen::Vector2d::Ones();
  }

  Eigen::MatrixXd noise_, jacobian_;  ///< of all data, one step after the other
};

InputError error_of_half() {
  InputError error{"half of the sensors", 0.03};
  error.readings.setZero(k_sensors);
  error.readings.head(k_sensors / 2).setOnes();
  return error;
}

TEST(InputErrors, OfReadingsShiftTheMeanAsTheNormalEquationsSay) {
  for (const double offset_std : {0.0, 0.3}) {
    const LinearTest test(offset_std);
    Eigen::MatrixXd altered = test.data;
    altered.topRows(k_sensors / 2) *= 1.03;
    const InputShift found = test.shift(error_of_half());
    EXPECT_LT((found.shift - (test.exact_mean(altered) - test.mean)).norm(), 1e-6) << offset_std;
    EXPECT_GT(found.in_std.norm(), 0.1);
    EXPECT_EQ(found.name, "half of the sensors");
    EXPECT_EQ(found.relative, 0.03);
  }
}

TEST(InputErrors, OfTheClockMoveTheModelBetweenItsTimes) {
  const LinearTest test;
  InputError error{"clock", 0.04};
  error.clock = 1;
  const InputShift found = test.shift(error);
  Eigen::MatrixXd altered = test.data;
  for (Index t = 0; t < k_times; ++t) {
    // Straight lines between the times 0.5, 1.5, …, and beyond the last.
    const Index k = std::min<Index>(t, k_times - 2);
    const double share = found.relative * (0.5 + t);
    altered.col(t) -=
        share * (test.problem.model->predict(test.mean, k + 1) - test.problem.model->predict(test.mean, k));
  }
  EXPECT_LT((found.shift - (test.exact_mean(altered) - test.mean)).norm(), 1e-6);
}

TEST(InputErrors, OfWhatActsLikeTheParametersShiftThemAsMuchAsTheDataDecide) {
  const LinearTest test;
  InputError error{"modulus", 0.01};
  error.parameters.resize(2);
  error.parameters << -1, 1;
  const Eigen::Vector2d expected(0.01 * test.mean[0], -0.01 * test.mean[1]);
  const Eigen::VectorXd found = test.shift(error).shift;
  // The prior takes back its share.
  EXPECT_LT((found - expected).norm(), 0.1 * expected.norm());
  Eigen::MatrixXd altered = test.data;
  const Eigen::Vector2d changed(test.mean[0] / 1.01, test.mean[1] * 1.01);
  for (Index t = 0; t < k_times; ++t) altered.col(t) -= test.slope(t) * (changed - test.mean);
  EXPECT_LT((found - (test.exact_mean(altered) - test.mean)).norm(), 1e-6);
}

/// The log-evidence falls by half of what χ² rises by.
TEST(InputErrors, ThatTheDataShowAreMadeSmallerUntilTheyDoNot) {
  const LinearTest test;
  InputError error = error_of_half();
  for (const double relative : {0.5, 1e3}) {
    error.relative = relative;
    const InputShift found = test.shift(error);
    EXPECT_TRUE(found.is_limited);
    Eigen::MatrixXd altered = test.data;
    altered.topRows(k_sensors / 2) *= 1 + found.relative;
    EXPECT_LT((found.shift - (test.exact_mean(altered) - test.mean)).norm(), 1e-6);
    const double fall = test.exact_log_evidence(test.data) - test.exact_log_evidence(altered);
    EXPECT_LE(fall, 20);
    EXPECT_GT(fall, 10);
  }
  EXPECT_FALSE(test.shift(error_of_half()).is_limited);
}

TEST(InputErrors, OfDataWithoutAPosteriorAreNone) {
  LinearTest test;
  const InputError error = error_of_half();
  const auto datum = likelihood::test::datum(0, Eigen::VectorXd::Constant(k_sensors, 1e200));
  EXPECT_TRUE(shifts_by(std::span(&error, 1), test.problem, std::span(&datum, 1), test.mean).empty());
}

}  // namespace
}  // namespace knothe::assimilation
