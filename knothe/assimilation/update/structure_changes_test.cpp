/// @file Data that grow old: forgetting, changes of the structure, known and found.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <numbers>

#include "knothe/assimilation/testing/test_priors.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/base/error.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using likelihood::test::LinearFunctions;

std::vector<posterior::Prior> priors() {
  return {posterior::Prior::normal(0, 1), posterior::Prior::normal(0.5, 1)};
}

const Eigen::VectorXd k_std = Eigen::VectorXd::Constant(5, 0.4);

/// The posterior ∝ prior · Π L_t^weight in closed form, and the log density of the next datum under it.
struct Discounted {
  Eigen::MatrixXd precision = Eigen::Matrix2d::Identity();
  Eigen::VectorXd information = Eigen::Vector2d(0, 0.5), prior = Eigen::Vector2d(0, 0.5);

  [[nodiscard]] Eigen::VectorXd mean() const {
    return Eigen::LLT<Eigen::MatrixXd>(precision).solve(information);
  }
  void raise(double power) {
    precision = (1 - power) * Eigen::MatrixXd::Identity(2, 2) + power * precision;
    information = (1 - power) * prior + power * information;
  }
  double assimilate(const Eigen::MatrixXd& h, const Eigen::VectorXd& y) {
    const Eigen::LLT<Eigen::MatrixXd> factor(precision);
    const Eigen::VectorXd miss = y - h * mean();
    Eigen::MatrixXd s = h * factor.solve(h.transpose());
    s.diagonal() += k_std.cwiseAbs2();
    const Eigen::LLT<Eigen::MatrixXd> of_s(s);
    const Eigen::VectorXd white = of_s.matrixL().solve(miss);
    precision += h.transpose() * k_std.cwiseAbs2().cwiseInverse().asDiagonal() * h;
    information += h.transpose() * k_std.cwiseAbs2().cwiseInverse().asDiagonal() * y;
    return -0.5 * (white.squaredNorm() + static_cast<double>(y.size()) * std::log(2 * std::numbers::pi)) -
           of_s.matrixLLT().diagonal().array().log().sum();
  }
};

/// An update of twelve data beside the closed form: `check(r, exact, increment)` after each step, where the
/// data before count with the power that `power_before` says.
template <class Power, class Check>
void beside_the_closed_form(SequentialUpdate& update, const model::ObservedModel& model,
                            const Eigen::MatrixXd& data, const Power& power_before, const Check& check) {
  Discounted exact;
  for (std::size_t t = 0; t < 12; ++t) {
    const auto i = static_cast<Eigen::Index>(t);
    const UpdateResult& r = update.update(t, t, data.col(i));
    if (t > 0) exact.raise(power_before(t));
    SCOPED_TRACE(t);
    check(r, exact, exact.assimilate(model.space * model.core[t], data.col(i) - model.lift.col(i)));
  }
}

TEST(ChangingStructure, ForgettingIsTheDiscountedGaussianInClosedForm) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(2), 5, 3, 12, 4);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(0.7, -0.3), k_std, 6);
  for (const double power : {0.95, 0.6}) {
    UpdateOptions options;
    options.forgetting = power;
    SequentialUpdate update(model, likelihood::NoiseModel::independent(k_std), priors(), options);
    double log_evidence = 0;
    beside_the_closed_form(
        update, *model, data, [&](std::size_t) { return power; },
        [&](const UpdateResult& r, const Discounted& exact, double increment) {
          log_evidence += increment;
          EXPECT_LT((r.mean - exact.mean()).norm(), 1e-8);
          EXPECT_NEAR(r.log_evidence_increment, increment, 1e-7);
          EXPECT_NEAR(r.log_evidence, log_evidence, 1e-6);
        });
  }
}

TEST(ChangingStructure, FiltersAndComposedMapsForgetAsTheClosedFormDoes) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(2), 5, 3, 12, 4);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(0.7, -0.3), k_std, 6);
  using posterior::Method;
  // An ensemble's moments are those of its members, exactly so for a linear model.
  for (const Method kind :
       {Method::extended_kalman, Method::unscented_kalman, Method::ensemble_kalman, Method::transport}) {
    SCOPED_TRACE(static_cast<int>(kind));
    UpdateOptions options;
    options.kind = kind;
    options.forgetting = 0.8;
    options.change_points = {7};
    if (kind == Method::transport) options.form = UpdateOptions::Form::composed;
    SequentialUpdate update(model, likelihood::NoiseModel::independent(k_std), priors(), options);
    double log_evidence = 0;
    beside_the_closed_form(
        update, *model, data, [](std::size_t t) { return t == 7 ? 0 : 0.8; },
        [&](const UpdateResult& r, const Discounted& exact, double increment) {
          log_evidence += increment;
          const Eigen::MatrixXd covariance = exact.precision.inverse();
          EXPECT_LT((r.mean - exact.mean()).norm(), 1e-6);
          EXPECT_LT((r.covariance - covariance).norm(), 1e-5 * covariance.norm());
          EXPECT_NEAR(r.log_evidence, log_evidence, 1e-6);
        });
    // A step that comes late: as if all had come in order.
    const Eigen::VectorXd mean = update.result().mean;
    update.remove(9);
    EXPECT_NE(update.result().mean, mean);
    update.update(9, 9, data.col(9));
    EXPECT_EQ(update.result().mean, mean);
  }
}

TEST(ChangingStructure, AnUnknownNoiseLevelIsFoundFromWhatStillCounts) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(2), 5, 3, 10, 4);
  const Eigen::MatrixXd data =
      likelihood::test::synthetic_data(*model, Eigen::Vector2d(0.7, -0.3), 1.5 * k_std, 6);
  const double power = 0.8, a = 2.5, b = 1.5;
  UpdateOptions options;
  options.forgetting = power;
  options.noise_level = likelihood::NoiseLevel(a, b);
  SequentialUpdate update(model, likelihood::NoiseModel::independent(k_std), priors(), options);
  // For each level s in closed form, and by the trapezoidal rule over log s.
  struct Exact {
    double log_evidence = 0, level = 0;
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  };
  const auto exact_of = [&](std::size_t count, const Eigen::VectorXd& powers) {
    Exact exact;
    double total = 0;
    for (double log_s = -5; log_s < 5; log_s += 0.005) {
      const double s = std::exp(log_s);
      const Eigen::Vector2d prior(0, 0.5);
      Eigen::Matrix2d precision = Eigen::Matrix2d::Identity();
      Eigen::Vector2d information = prior;
      double log_value = a * std::log(b) - std::lgamma(a) - a * log_s - b / s - 0.5 * prior.squaredNorm();
      for (std::size_t t = 0; t < count; ++t) {
        const auto i = static_cast<Eigen::Index>(t);
        const Eigen::MatrixXd h = model->space * model->core[t];
        const Eigen::VectorXd y = data.col(i) - model->lift.col(i);
        const double w = powers[i], variance = s * k_std[0] * k_std[0];
        precision += w / variance * h.transpose() * h;
        information += w / variance * h.transpose() * y;
        log_value -= 0.5 * w * (5 * std::log(2 * std::numbers::pi * variance) + y.squaredNorm() / variance);
      }
      const Eigen::Vector2d mean = precision.inverse() * information;
      const double mass =
          0.005 * std::exp(log_value + 0.5 * information.dot(mean) - 0.5 * std::log(precision.determinant()));
      total += mass, exact.mean += mass * mean, exact.level += mass * s;
    }
    exact.mean /= total, exact.level /= total, exact.log_evidence = std::log(total);
    return exact;
  };
  Eigen::VectorXd powers;
  double log_evidence = 0;
  for (std::size_t t = 0; t < 10; ++t) {
    const auto i = static_cast<Eigen::Index>(t);
    const UpdateResult& r = update.update(t, t, data.col(i));
    powers = (power * powers).eval();
    const double widened = exact_of(t, powers).log_evidence;
    powers.conservativeResize(i + 1);
    powers[i] = 1;
    const Exact exact = exact_of(t + 1, powers);
    log_evidence += exact.log_evidence - widened;
    for (Eigen::Index k = 0; k < 2; ++k)
      EXPECT_NEAR(r.mean[k], exact.mean[k], 0.01 * std::sqrt(r.covariance(k, k))) << t;
    EXPECT_NEAR(r.log_evidence, log_evidence, 0.01 * (1.0 + t)) << t;
    EXPECT_NEAR(r.noise_level.value(), exact.level, 0.01 * exact.level) << t;
  }
}

TEST(ChangingStructure, AfterAKnownChangeThePosteriorIsThatOfTheLaterDataAlone) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), 5, 3, 10, 4);
  const Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(0.7, 1.3), k_std, 6);
  UpdateOptions options;
  options.change_points = {6};
  SequentialUpdate both(model, likelihood::NoiseModel::independent(k_std), test::papers_priors(), options);
  SequentialUpdate early(model, likelihood::NoiseModel::independent(k_std), test::papers_priors());
  SequentialUpdate late(model, likelihood::NoiseModel::independent(k_std), test::papers_priors());
  for (std::size_t t = 0; t < 10; ++t) {
    const auto values = data.col(static_cast<Eigen::Index>(t));
    both.update(t, t, values);
    (t < 6 ? early : late).update(t, t, values);
  }
  EXPECT_EQ(both.result().mean, late.result().mean);
  EXPECT_EQ(both.result().covariance, late.result().covariance);
  EXPECT_NEAR(both.result().log_evidence, early.result().log_evidence + late.result().log_evidence, 1e-9);
  // A step withdrawn and assimilated again leaves no trace, before the change or after it.
  const Eigen::VectorXd mean = both.result().mean;
  const double log_evidence = both.result().log_evidence;
  for (const std::size_t t : {3, 8, 9}) {
    both.remove(t);
    EXPECT_NE(both.result().log_evidence, log_evidence);
    both.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    EXPECT_EQ(both.result().mean, mean);
    EXPECT_EQ(both.result().log_evidence, log_evidence);
  }
}

TEST(ChangingStructure, AnAlarmIsTakenForAChangeWhereTheDriftBegan) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(2), 5, 3, 30, 4);
  const Eigen::Vector2d before(0.7, -0.3), after(-0.2, 0.6);
  Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, before, k_std, 6);
  data.rightCols(15) = likelihood::test::synthetic_data(*model, after, k_std, 7).rightCols(15);
  UpdateOptions options;
  options.restart_on_alarm = true;
  SequentialUpdate update(model, likelihood::NoiseModel::independent(k_std), priors(), options);
  SequentialUpdate stubborn(model, likelihood::NoiseModel::independent(k_std), priors());
  std::string words;
  for (std::size_t t = 0; t < 30; ++t) {
    const auto values = data.col(static_cast<Eigen::Index>(t));
    if (t != 10) words += update.update(t, t, values).notice;
    stubborn.update(t, t, values);
  }
  // A sum may have begun to rise by chance before; what is left of the old data then rings once more.
  ASSERT_FALSE(update.changes().found().empty());
  EXPECT_LE(update.changes().found().size(), 2u) << words;
  EXPECT_NEAR(static_cast<double>(update.changes().found().back()), 15, 1);
  EXPECT_NE(words.find("treated as a change of the structure at step"), std::string::npos) << words;
  const auto distance = [&](const UpdateResult& r) {
    const Eigen::VectorXd miss = r.mean - after;
    return std::sqrt(miss.dot(Eigen::LLT<Eigen::MatrixXd>(r.covariance).solve(miss)));
  };
  EXPECT_LT(distance(update.result()), 4);
  EXPECT_GT(distance(stubborn.result()), 10);
  // A step that comes late: as if all had come in order.
  update.update(10, 10, data.col(10));
  SequentialUpdate in_order(model, likelihood::NoiseModel::independent(k_std), priors(), options);
  for (std::size_t t = 0; t < 30; ++t) in_order.update(t, t, data.col(static_cast<Eigen::Index>(t)));
  EXPECT_EQ(update.result().mean, in_order.result().mean);
  EXPECT_EQ(update.result().log_evidence, in_order.result().log_evidence);
  EXPECT_EQ(update.changes().found(), in_order.changes().found());
}

TEST(ChangingStructure, WhatDoesNotGoTogetherIsNamed) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(2), 5, 3, 2, 4);
  const auto refused = [&](UpdateOptions options, const likelihood::NoiseModel& noise) -> std::string {
    options.forgetting = 0.95;
    try {
      SequentialUpdate(model, noise, priors(), options);
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  const likelihood::NoiseModel noise = likelihood::NoiseModel::independent(k_std);
  EXPECT_EQ(refused({}, noise), "");
  UpdateOptions biased;
  biased.bias_correction = likelihood::BiasCorrectionMode::on;
  EXPECT_NE(refused(biased, noise).find("cannot be combined with bias_correction"), std::string::npos);
  EXPECT_NE(refused({}, noise.with_offsets(0.1)).find("errors that steps share"), std::string::npos);
}

}  // namespace
}  // namespace knothe::assimilation
