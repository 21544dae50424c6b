#include "knothe/assimilation/decide/decider.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

using testing::HasSubstr;

constexpr double k_noise = 0.1, k_threshold = 1.5;
constexpr int k_times = 20;
const Eigen::Vector2d k_prior_std(0.2, 0.15);

double time_of(int step) {
  return 0.05 * (step + 1);
}

/// Two sensors, y = (t a, t² b); the output "wear" is t (a + b). All linear in a and b, 0 to 2.
model::SeparatedModel linear_model() {
  model::ModelContents m;
  const std::vector<double> nodes = {0, 0.5, 1, 1.5, 2};
  m.axes = {{"a", nodes, "1", "", 1}, {"b", nodes, "1", "", 1}};
  m.space_modes = m.parameter_modes = 2;
  m.space = {1, 0, 0, 1};
  m.dofs = {{0, 0, 0, 1, 0, 0}, {0, 0}};
  m.lift.assign(2 * k_times, 0);
  model::SnapshotOutput wear, imposed;
  wear.name = "wear", wear.labels.units = "mm";
  imposed.name = "imposed_displacement", imposed.labels.units = "m";
  for (int t = 0; t < k_times; ++t) {
    m.time.push_back(time_of(t));
    for (const double entry : {time_of(t), 0.0, 0.0, time_of(t) * time_of(t)}) m.temporal.push_back(entry);
  }
  for (const double a : nodes)
    for (std::size_t k = 0; k < nodes.size(); ++k) m.joint.push_back(a);
  for (const double a : nodes)
    for (const double b : nodes) {
      m.joint.push_back(b);
      for (const double t : m.time) wear.values.push_back(t * (a + b)), imposed.values.push_back(1e-3 * t);
    }
  m.outputs = {wear, imposed};
  return model::SeparatedModel(std::move(m), "linear.h5");
}

ForecastSpecification wear_forecast() {
  ForecastSpecification wear;
  wear.name = "wear";
  wear.quantity = ForecastSpecification::Quantity::output;
  wear.output = "wear";
  wear.horizon = 1;
  wear.threshold = k_threshold;
  return wear;
}

Decider decider(DecisionOptions options, ForecastSpecification wear = wear_forecast()) {
  options.failure = "wear";
  const model::SeparatedModel model = linear_model();
  const auto observed =
      std::make_shared<const model::ObservedModel>(model::observe(model, model.contents().dofs));
  return {model,
          observed,
          model.contents().dofs,
          likelihood::GaussianNoise::independent(Eigen::Vector2d::Constant(k_noise)),
          k_prior_std,
          {wear},
          std::move(options)};
}

/// N(mean, covariance) at 1,024 points, after a datum of that time.
UpdateResult normal_posterior(const Eigen::Vector2d& mean, const Eigen::Matrix2d& covariance, double time) {
  static const Eigen::MatrixXd k_standard = numerics::sobol_normal_points(1024, 2, 1);
  const Eigen::Matrix2d factor = covariance.llt().matrixL();
  UpdateResult posterior;
  posterior.points = ((k_standard * factor.transpose()).rowwise() + mean.transpose()).cwiseMax(0).cwiseMin(2);
  posterior.weights = Eigen::VectorXd::Constant(k_standard.rows(), 1.0 / k_standard.rows());
  posterior.mean = mean;
  posterior.covariance = covariance;
  posterior.time = time;
  return posterior;
}

Eigen::Matrix2d information_at(double t) {
  return Eigen::Vector2d(t * t, t * t * t * t).asDiagonal() * (1 / (k_noise * k_noise));
}

const Eigen::Matrix2d k_covariance = (Eigen::Matrix2d() << 0.04, 0.01, 0.01, 0.02).finished();

TEST(Decider, InformationOfALinearGaussianProblemIsExact) {
  const Eigen::Matrix2d of_prior = k_prior_std.cwiseAbs2().cwiseInverse().asDiagonal(),
                        of_data = 4 * information_at(0.3);
  const Eigen::Matrix2d known = of_prior + of_data;
  const UpdateResult posterior = normal_posterior({0.6, 0.6}, known.inverse(), 0.05);
  const std::vector<std::pair<std::string, Eigen::MatrixXd>> targets = {{"", Eigen::Matrix2d::Identity()},
                                                                        {"a", Eigen::RowVector2d(1, 0)},
                                                                        {"b", Eigen::RowVector2d(0, 1)},
                                                                        {"wear", Eigen::RowVector2d(1, 1)}};
  for (const auto& [about, rows] : targets) {
    DecisionOptions options;
    options.about = about, options.risk = 1;
    // By the form of the data, and by the posterior's covariance alone.
    for (const Eigen::MatrixXd& data : {Eigen::MatrixXd(of_data), Eigen::MatrixXd()}) {
      const Decision decision = decider(options).decide(posterior, data);
      EXPECT_EQ(decision.action, Action::load);
      const Eigen::Matrix2d after = known + information_at(decision.time);
      const Eigen::MatrixXd before = rows * known.inverse() * rows.transpose(),
                            then = rows * after.inverse() * rows.transpose();
      EXPECT_NEAR(decision.information, 0.5 * std::log(before.determinant() / then.determinant()), 1e-9);
      EXPECT_NEAR(decision.time, 1, 1e-12);  // the signal grows with the load
      EXPECT_NEAR(decision.load.value(), 1e-3, 1e-12);
      EXPECT_EQ(decision.load_units, "m");
    }
  }
}

TEST(Decider, NoiseThatIsLargerThanStatedTellsLess) {
  const Eigen::Matrix2d of_prior = k_prior_std.cwiseAbs2().cwiseInverse().asDiagonal(),
                        of_data = 4 * information_at(0.3);
  const double level = 25;  // of the variance
  const Eigen::Matrix2d known = of_prior + of_data / level;
  UpdateResult posterior = normal_posterior({0.6, 0.6}, known.inverse(), 0.05);
  posterior.noise_level = level;
  DecisionOptions options;
  options.risk = 1;
  for (const Eigen::MatrixXd& data : {Eigen::MatrixXd(of_data), Eigen::MatrixXd()}) {
    const Decision decision = decider(options).decide(posterior, data);
    const Eigen::Matrix2d after = known + information_at(decision.time) / level;
    EXPECT_NEAR(decision.information, 0.5 * std::log(after.determinant() / known.determinant()), 1e-9);
  }
}

/// About a alone: a + b tells nothing while b is unknown, and b tells nothing of a until a + b is known.
TEST(ExpectedInformation, OfSomeParametersAMeasurementTellsMoreOnceOthersAreKnown) {
  model::ObservedModel sums = model::observe(linear_model(), linear_model().contents().dofs);
  sums.core[0] << 1, 1, 0, 0;
  sums.core[1] << 0, 0, 0, 1;
  ExpectedInformation information(std::make_shared<const model::ObservedModel>(sums),
                                  likelihood::GaussianNoise::independent(Eigen::Vector2d::Constant(0.1)));
  const Eigen::Matrix2d prior = Eigen::Vector2d(1, 0.01).asDiagonal();
  information.set(Eigen::RowVector2d(0.5, 0.5), prior, {}, Eigen::RowVector2d(1, 0));
  EXPECT_NEAR(information.of(1), 0, 1e-12);
  const std::vector<PlannedMeasurement> planned = information.plan(std::vector<std::size_t>{0, 1}, 0.001);
  ASSERT_GE(planned.size(), 2u);
  EXPECT_EQ(planned[0].step, 0u);
  EXPECT_EQ(planned[1].step, 1u);
  const auto variance_of_a = [](const Eigen::Matrix2d& precision) { return precision.inverse()(0, 0); };
  const Eigen::Matrix2d with_sum = prior + Eigen::Matrix2d::Constant(100);
  Eigen::Matrix2d with_both = with_sum;
  with_both(1, 1) += 100;
  EXPECT_NEAR(planned[1].information, 0.5 * std::log(variance_of_a(with_sum) / variance_of_a(with_both)),
              1e-9);
}

TEST(ExpectedInformation, WhatDependsOnNoParameterIsNotLearntAbout) {
  ExpectedInformation information(std::make_shared<const model::ObservedModel>(
                                      model::observe(linear_model(), linear_model().contents().dofs)),
                                  likelihood::GaussianNoise::independent(Eigen::Vector2d::Ones()));
  const Eigen::Matrix2d prior = k_covariance.inverse();
  information.set(Eigen::RowVector2d(0.5, 0.5), prior, {}, Eigen::RowVector2d(0, 0));
  EXPECT_EQ(information.of(3), 0);
  EXPECT_TRUE(information.plan(std::vector<std::size_t>{3}, 0).empty());
  const Eigen::Matrix2d endless = Eigen::Matrix2d::Constant(std::numeric_limits<double>::infinity());
  EXPECT_THROW(information.set(Eigen::RowVector2d(0.5, 0.5), endless, {}, Eigen::RowVector2d(1, 0)),
               NumericalError);
}

/// Where a sensor sees nothing at high loads the loads that tell about it are planned first.
TEST(ExpectedInformation, APlanIsTheGreedyChoiceByHand) {
  model::ObservedModel fading = model::observe(linear_model(), linear_model().contents().dofs);
  for (int t = 0; t < k_times; ++t) fading.core[t](1, 1) = t == 3 ? 1.0 : 0.02 * t;  // b is seen at one load
  const auto model = std::make_shared<const model::ObservedModel>(fading);
  ExpectedInformation information(model,
                                  likelihood::GaussianNoise::independent(Eigen::Vector2d::Constant(k_noise)));
  const Eigen::Matrix2d prior = k_covariance.inverse();
  information.set(Eigen::RowVector2d(0.5, 0.5), prior, {}, Eigen::Matrix2d::Identity());
  std::vector<std::size_t> steps(k_times);
  std::iota(steps.begin(), steps.end(), 0);
  const double least = 0.1;
  Eigen::Matrix2d precision = prior;
  std::vector<std::size_t> by_hand, planned;
  for (;;) {
    double best = least;
    std::size_t chosen = k_times;
    Eigen::Matrix2d next;
    for (const std::size_t step : steps) {
      const Eigen::Vector2d seen(fading.core[step](0, 0) / k_noise, fading.core[step](1, 1) / k_noise);
      Eigen::Matrix2d with = precision;
      with.diagonal() += seen.cwiseAbs2();
      const double gain = 0.5 * std::log(with.determinant() / precision.determinant());
      if (gain > best) best = gain, chosen = step, next = with;
    }
    if (chosen == k_times) break;
    by_hand.push_back(chosen), precision = next;
  }
  double total = 0;
  for (const PlannedMeasurement& one : information.plan(steps, least))
    planned.push_back(one.step), total += one.information;
  EXPECT_EQ(planned, by_hand);
  EXPECT_NE(std::find(planned.begin(), planned.end(), 3), planned.end());
  EXPECT_NEAR(total, 0.5 * std::log(precision.determinant() / prior.determinant()), 1e-9);
  EXPECT_NEAR(information.of(3), information.plan(std::vector<std::size_t>{3}, 0)[0].information, 1e-12);
}

/// The rule written out for normal wear: the last time whose probability of failure is within what its share
/// of the load may add.
double furthest_by_hand(double mean, double std, double now, double risk) {
  const auto failed = [&](double t) { return numerics::normal_cdf((t * mean - k_threshold) / (t * std)); };
  double last = now;
  for (int step = 0; step < k_times; ++step) {
    const double t = time_of(step);
    if (t > now && failed(t) <= std::min(risk, failed(now) + risk * (t - now) / 0.95)) last = t;
  }
  return last;
}

TEST(Decider, LoadsAsFarAsTheRiskAllows) {
  DecisionOptions options;
  for (const double risk : {0.01, 0.05, 0.2})
    for (const double mean : {0.5, 0.8, 0.95}) {
      options.risk = risk;
      const Decision decision = decider(options).decide(normal_posterior({mean, mean}, k_covariance, 0.05));
      const double std = std::sqrt(k_covariance.sum());
      // The kernel between the draws widens by 4 %: a step less, never a step more.
      const double by_hand = furthest_by_hand(2 * mean, std, 0.05, risk);
      EXPECT_LE(decision.furthest, by_hand + 1e-9) << risk << " " << mean;
      EXPECT_GE(decision.furthest, by_hand - 0.05 - 1e-9) << risk << " " << mean;
      EXPECT_LE(*decision.failure_probability, *decision.allowed_probability);
    }
}

TEST(Decider, WhatIsDoubtedIsLoadedLess) {
  const auto furthest = [](const std::function<void(UpdateResult&)>& change,
                           const ForecastSpecification& wear = wear_forecast()) {
    UpdateResult posterior = normal_posterior({0.8, 0.8}, k_covariance, 0.05);
    change(posterior);
    return decider({}, wear).decide(posterior).furthest;
  };
  const double sure = furthest([](UpdateResult&) {});
  EXPECT_LT(furthest([](UpdateResult& p) { p.verdict.level = VerdictLevel::caution; }), sure);
  EXPECT_LT(furthest([](UpdateResult& p) { p.verdict.model_shift_std = Eigen::Vector2d(0.2, 1.5); }), sure);
  ForecastSpecification uncertain = wear_forecast();
  uncertain.model_error_std = 0.3;
  EXPECT_LT(furthest([](UpdateResult&) {}, uncertain), sure);

  UpdateResult rejected = normal_posterior({0.8, 0.8}, k_covariance, 0.3);
  rejected.verdict.level = VerdictLevel::reject;
  const Decision held = decider({}).decide(rejected);
  EXPECT_EQ(held.action, Action::hold);
  EXPECT_EQ(held.time, 0.3);
  EXPECT_THAT(held.message, HasSubstr("the verdict is reject: do not load on"));
  EXPECT_FALSE(held.failure_probability.has_value());
}

/// Of parameters that the data know as a sum only, errors of half a standard deviation each move that sum by
/// many of its own.
TEST(Decider, TheErrorOfTheReducedModelIsCarriedToTheQuantity) {
  const Eigen::Matrix2d covariance = 0.01 * (Eigen::Matrix2d() << 1, -0.99, -0.99, 1).finished();
  UpdateResult posterior = normal_posterior({0.8, 0.8}, covariance, 0.05);
  posterior.verdict.model_shift_std = Eigen::Vector2d(0.5, -0.5);
  DecisionOptions options;
  options.risk = 0.05;
  const double std = std::hypot(std::sqrt(covariance.sum()), 2 * 0.5 * 0.1);
  const double by_hand = furthest_by_hand(1.6, std, 0.05, options.risk);
  EXPECT_LT(by_hand, furthest_by_hand(1.6, std::sqrt(covariance.sum()), 0.05, options.risk) - 0.01);
  EXPECT_NEAR(decider(options).decide(posterior).furthest, by_hand, 0.05 + 1e-9);
  EXPECT_LE(decider(options).decide(posterior).furthest, by_hand + 1e-9);
}

TEST(Decider, AnIncrementIsCountedFromWhereTheSpecimenIs) {
  DecisionOptions options;
  options.cost = 0;
  const double between = time_of(3) - 0.001;
  const Decision decision =
      decider(options).decide(normal_posterior({0.8, 0.8}, 1e-4 * k_covariance, between));
  EXPECT_EQ(decision.action, Action::load);
  EXPECT_NEAR(*decision.allowed_probability, options.risk * (decision.time - between) / 0.95, 1e-9);
}

TEST(Decider, WhatHasNoProbabilityIsNotLoaded) {
  UpdateResult posterior = normal_posterior({0.8, 0.8}, k_covariance, 0.05);
  posterior.weights.setZero();
  EXPECT_THROW(decider({}).decide(posterior), NumericalError);
  posterior.weights.setOnes();
  posterior.points(7, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(decider({}).decide(posterior), NumericalError);
}

TEST(Decider, StopsAndSaysWhy) {
  DecisionOptions options;
  const auto message = [&](const Eigen::Vector2d& mean, double spread, double time) {
    const Decision decision =
        decider(options).decide(normal_posterior(mean, spread * spread * k_covariance, time));
    EXPECT_EQ(decision.action, Action::stop);
    EXPECT_EQ(decision.time, time);
    return decision.message;
  };
  EXPECT_THAT(message({0.8, 0.8}, 0.01, 1),
              HasSubstr("P(wear > 1.5 mm) is > 99.9 % already, of 5 % allowed in the whole test"));
  EXPECT_THAT(message({0.6, 0.6}, 0.01, 1),
              HasSubstr("the load is at its end, and another measurement tells too little"));
  EXPECT_THAT(message({0.8, 0.8}, 0.01, 0.9), HasSubstr("after the next step of load, 0.263 % is allowed"));
  options.cost = 10;
  EXPECT_THAT(message({0.6, 0.6}, 1, 0.5), HasSubstr("no measurement that the risk allows tells 10 nats"));
}

TEST(Decider, OffersWhatTheProjectNames) {
  DecisionOptions options;
  options.increments = {0.1, 0.25};
  const UpdateResult posterior = normal_posterior({0.4, 0.4}, k_covariance, 0.05);
  EXPECT_NEAR(decider(options).decide(posterior).time, 0.3, 1e-12);
  options.increments.clear();
  options.end = 0.6;
  EXPECT_NEAR(decider(options).decide(posterior).time, 0.6, 1e-12);
  // Where the signal no longer grows, the specimen is looked at again.
  options.end = 0.05;
  options.cost = 0;
  EXPECT_EQ(decider(options).decide(posterior).action, Action::hold);
}

TEST(Decider, SaysWhatTheProjectLacks) {
  const auto message = [](const DecisionOptions& given, const ForecastSpecification& wear) -> std::string {
    try {
      const model::SeparatedModel model = linear_model();
      const Decider made(
          model, std::make_shared<const model::ObservedModel>(model::observe(model, model.contents().dofs)),
          model.contents().dofs, likelihood::GaussianNoise::independent(Eigen::Vector2d::Ones()), k_prior_std,
          {wear}, given);
    } catch (const ProjectError& error) {
      return error.what();
    }
    return "";
  };
  DecisionOptions options;
  options.failure = "waer";
  EXPECT_THAT(
      message(options, wear_forecast()),
      HasSubstr("[decide.failure] \"waer\" is not a forecast (did you mean \"wear\"?); there are: wear"));
  options.failure = "wear";
  ForecastSpecification open = wear_forecast();
  open.threshold.reset();
  EXPECT_THAT(message(options, open), HasSubstr("[decide.failure] forecast.wear needs \"threshold\""));
  options.about = "c";
  EXPECT_THAT(message(options, wear_forecast()),
              HasSubstr("[decide.about] \"c\" is neither a parameter nor a forecast (did you mean \"a\"?); "
                        "there are: a, b, wear"));
  options.about.clear();
  options.end = 3;
  EXPECT_THAT(message(options, wear_forecast()), HasSubstr("[decide] end = 3: the model knows the times"));
  options.end.reset();
  options.increments = {0.1, 0.12};
  EXPECT_THAT(
      message(options, wear_forecast()),
      HasSubstr("[decide.increments] no two times of the model are 0.12 apart; its first two are 0.05"));
}

struct Outcome {
  bool failed = false;
  int measurements = 0;
  double std = 0;  ///< of a + b
};

/// A test of a specimen (a, b) as it is decided, its posteriors by the conjugate formula.
Outcome driven_test(Decider& decider, const Eigen::Vector2d& truth, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  Eigen::Vector2d mean(0.7, 0.7);
  Eigen::Matrix2d precision = k_covariance.inverse();
  double time = time_of(0);
  Outcome outcome;
  for (;;) {
    const Eigen::Vector2d signal(time, time * time);
    const Eigen::Vector2d datum =
        signal.cwiseProduct(truth) + k_noise * Eigen::Vector2d(normal(random), normal(random));
    const Eigen::Matrix2d updated = precision + information_at(time);
    mean = updated.llt().solve(precision * mean + signal.cwiseProduct(datum) / (k_noise * k_noise));
    precision = updated;
    ++outcome.measurements;
    const Eigen::Matrix2d covariance = precision.inverse();
    outcome.std = std::sqrt(covariance.sum());
    const Decision decision = decider.decide(normal_posterior(mean, covariance, time));
    if (decision.action == Action::stop || outcome.measurements == 200) break;
    time = decision.time;
  }
  outcome.failed = time * truth.sum() > k_threshold;
  return outcome;
}

TEST(Decider, ATestDrivenToItsEndFailsNoMoreOftenThanIsAllowed) {
  DecisionOptions options;
  options.about = "wear";
  options.cost = 0.05;
  Decider decides = decider(options);
  const Eigen::Matrix2d factor = k_covariance.llt().matrixL();
  constexpr int k_tests = 400;
  int failures = 0;
  double std = 0, measurements = 0;
  for (int k = 0; k < k_tests; ++k) {
    std::mt19937_64 random(k);
    std::normal_distribution<double> normal;
    const Eigen::Vector2d truth =
        Eigen::Vector2d(0.7, 0.7) + factor * Eigen::Vector2d(normal(random), normal(random));
    const Outcome outcome = driven_test(decides, truth, random);
    failures += outcome.failed;
    measurements += outcome.measurements;
    std += outcome.std;
  }
  std::printf("%d of %d specimens fail, %.1f measurements, std of a + b %.3f\n", failures, k_tests,
              measurements / k_tests, std / k_tests);
  // 5 % are allowed: 20, with three standard deviations of their number.
  EXPECT_LE(failures, 20 + 13);
  EXPECT_LT(measurements / k_tests, 100);
}

}  // namespace
}  // namespace knothe::assimilation
