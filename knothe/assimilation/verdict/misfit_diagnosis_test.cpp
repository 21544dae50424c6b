#include "knothe/assimilation/verdict/misfit_diagnosis.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "knothe/assimilation/testing/verdict_case.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using test::Bench;
using test::k_case_sensors;
using test::k_case_times;

TEST(Verdict, NamesWhatIsWrongWithTheData) {
  Bench bench;
  const MatrixXd right = bench.data;
  EXPECT_FALSE(bench.cause());
  bench.data = -right;
  EXPECT_EQ(bench.cause(), MisfitCause::sign);
  bench.data = 1e3 * right;
  EXPECT_EQ(bench.cause(), MisfitCause::scale);
  bench.data = right;
  for (Index i = 1; i < k_case_sensors; i += 2) bench.data.row(i) *= -1;
  EXPECT_EQ(bench.cause(), MisfitCause::sign);
  for (Index i = 0; i < k_case_sensors; i += 2) {
    bench.data.row(i) = right.row(i + 1);
    bench.data.row(i + 1) = right.row(i);
  }
  EXPECT_EQ(bench.cause(), MisfitCause::component);
  for (Index i = 0; i < k_case_sensors; ++i) bench.data.row(i) = right.row((i + 7) % k_case_sensors);
  EXPECT_EQ(bench.cause(), MisfitCause::sensor_order);
  bench.data = right;
  bench.data.leftCols(k_case_times - 2) = right.rightCols(k_case_times - 2);
  bench.data.conservativeResize(Eigen::NoChange, k_case_times - 2);
  EXPECT_EQ(bench.cause(), MisfitCause::time_shift);
  bench.data = right;
  bench.data(3, 4) += 50;
  EXPECT_EQ(bench.cause(), MisfitCause::single_sensor);
  bench.data = right;
  bench.data.row(5).array() += 0.4;
  EXPECT_EQ(bench.cause(), MisfitCause::single_sensor);
  // One sensor of the wrong unit or sign, which no other value of it contradicts.
  bench.data = right;
  bench.data.row(5) *= 1e-3;
  EXPECT_EQ(bench.cause(), MisfitCause::scale);
  bench.data.row(5) = -right.row(5);
  EXPECT_EQ(bench.cause(), MisfitCause::sign);
  bench.data = right;
  for (const double factor : {0.3, 3.0}) {
    bench.data = right;
    bench.noise = likelihood::NoiseModel::independent(VectorXd::Constant(k_case_sensors, 0.1 * factor));
    EXPECT_EQ(bench.cause(), MisfitCause::noise_level) << factor;
  }
}

/// The reason that a bench's data do not fit.
VerdictReason fit_reason(const Bench& bench) {
  for (const VerdictReason& reason : bench.verdict().reasons)
    if (reason.part == VerdictPart::fit) return reason;
  return {};
}

void expect_named(const Bench& bench, MisfitCause cause, const std::string& words) {
  const VerdictReason reason = fit_reason(bench);
  ASSERT_TRUE(reason.cause) << words;
  EXPECT_EQ(*reason.cause, cause) << reason.message;
  EXPECT_NE(reason.message.find(words), std::string::npos) << reason.message;
}

/// Data whose time is `time_of` the step, with noise.
Bench timed(const std::function<double(double)>& time_of, Index count = k_case_times, unsigned seed = 1) {
  Bench bench(seed);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  bench.data.resize(k_case_sensors, count);
  for (Index t = 0; t < count; ++t) {
    const double at = std::clamp(time_of(static_cast<double>(t)), 0.0, k_case_times - 1.0);
    const auto below = std::min(static_cast<std::size_t>(at), static_cast<std::size_t>(k_case_times) - 2);
    const double share = at - static_cast<double>(below);
    bench.data.col(t) = (1 - share) * bench.model->predict(bench.truth, below) +
                        share * bench.model->predict(bench.truth, below + 1);
    for (double& value : bench.data.col(t)) value += 0.1 * normal(random);
  }
  return bench;
}

TEST(MisfitDiagnosis, AFrameThatIsLostOrTooManyIsNamedWithItsStep) {
  for (const int at : {8, 12, 20}) {
    expect_named(timed([at](double t) { return t < at ? t : t + 1; }, k_case_times - 1),
                 MisfitCause::lost_frame,
                 "from step " + std::to_string(at) + " on the data match the model 1 step later: a picture");
    expect_named(timed([at](double t) { return t < at ? t : t - 1; }), MisfitCause::lost_frame,
                 "from step " + std::to_string(at) +
                     " on the data match the model 1 step earlier: there is one too many");
  }
  expect_named(timed([](double t) { return t < 10 ? t : t + 2; }, k_case_times - 2), MisfitCause::lost_frame,
               "from step 10 on the data match the model 2 steps later");
}

TEST(MisfitDiagnosis, SeveralFramesThatAreLostAreNamedEach) {
  const auto late = [](double t) { return t < 8 ? t : t < 18 ? t + 1 : t + 2; };
  const auto early = [](double t) { return t < 9 ? t : t < 19 ? t - 1 : t - 3; };
  for (unsigned seed = 1; seed <= 4; ++seed) {
    expect_named(timed(late, k_case_times - 2, seed), MisfitCause::lost_frame,
                 "from step 8 on the data match the model 1 step later, from step 18 on 2 steps later: "
                 "pictures or data are missing there");
    expect_named(timed(early, k_case_times, seed), MisfitCause::lost_frame,
                 "from step 9 on the data match the model 1 step earlier, from step 19 on 3 steps earlier: "
                 "there are some too many");
  }
}

TEST(MisfitDiagnosis, ATimeBaseThatIsBentIsNoShift) {
  for (const double most : {1.0, -1.5})
    expect_named(timed([most](double t) { return t + most * std::sin(M_PI * t / (k_case_times - 1)); }),
                 MisfitCause::time_base,
                 most > 0 ? "steps later (about step 1" : "steps earlier (about step 1");
  expect_named(timed([](double t) { return t + 1.5; }, k_case_times - 2), MisfitCause::time_shift,
               "1.5 steps later");
}

TEST(MisfitDiagnosis, AFactorInAPartOfThePictureIsNamedWithThePart) {
  for (const double factor : {1.05, 0.9}) {
    Bench bench;
    for (Index i = 0; i < k_case_sensors; ++i)
      if (bench.sensors.point(i)[0] > 0.55) bench.data.row(i) *= factor;
    expect_named(bench, MisfitCause::scale, "displacements at x");
    EXPECT_NE(fit_reason(bench).message.find("0.6 m look like the model's times "), std::string::npos);
  }
}

TEST(MisfitDiagnosis, ARangeThatEndsIsNoScale) {
  Bench bench;
  const double end = 0.5 * bench.data.cwiseAbs().maxCoeff();
  bench.data = bench.data.cwiseMin(end).cwiseMax(-end);
  expect_named(bench, MisfitCause::saturation, "the range of the sensors ends there");
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (double& value : bench.data.reshaped())
    if (std::abs(value) == end) value += 0.1 * normal(random);
  expect_named(bench, MisfitCause::saturation, " but for noise, all others fit: the range of the sensors");
}

TEST(MisfitDiagnosis, EachSensorMayHaveARangeOfItsOwn) {
  Bench bench;
  for (Index i = 0; i < k_case_sensors; ++i) {
    VectorXd sizes = bench.data.row(i).cwiseAbs();
    std::sort(sizes.begin(), sizes.end());
    const double end = sizes[k_case_times - 3 - i % 5];
    bench.data.row(i) = bench.data.row(i).cwiseMin(end).cwiseMax(-end).eval();
  }
  expect_named(bench, MisfitCause::saturation, "are the largest of their series to the last digit");
}

TEST(MisfitDiagnosis, AnUnloadingInBetweenIsNoScale) {
  Bench bench;
  bench.data.middleCols(12, 5) *= 0.7;
  expect_named(bench, MisfitCause::few_steps,
               "the data of steps 12 to 16 do not fit, those before and after do");
}

TEST(MisfitDiagnosis, SeveralUnloadingsAreNamed) {
  Bench bench;
  bench.data.middleCols(8, 3) *= 0.7;
  bench.data.middleCols(18, 4) *= 0.6;
  expect_named(bench, MisfitCause::few_steps,
               "the data of steps 8 to 10, 18 to 21 do not fit, those before and after do");
}

/// Values that stand out in several steps are not these steps.
TEST(MisfitDiagnosis, SpikesOfSensorsAreNoUnloading) {
  Bench bench;
  for (const auto& [sensor, step] : {std::pair{3, 8}, {10, 11}, {17, 14}, {20, 14}})
    bench.data(sensor, step) += 5;
  const VerdictReason reason = fit_reason(bench);
  ASSERT_TRUE(reason.cause);
  EXPECT_NE(*reason.cause, MisfitCause::few_steps) << reason.message;
}

TEST(MisfitDiagnosis, ConstantsOfTheSensorsAreNamedAndWithAShiftAPreload) {
  Bench bench;
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  for (Index i = 0; i < k_case_sensors; ++i) bench.data.row(i).array() += 0.5 * normal(random);
  expect_named(bench, MisfitCause::offset,
               "every sensor is off by a constant of its own: the reference picture");
  Bench preloaded = timed([](double t) { return t + 3; }, k_case_times - 3);
  preloaded.data.colwise() -= VectorXd(preloaded.model->predict(preloaded.truth, 3));
  expect_named(preloaded, MisfitCause::offset, "3 steps later: the zero was taken under a preload");
}

TEST(MisfitDiagnosis, SensorsThatAreListedTwiceAreNamed) {
  Bench bench;
  auto twice = std::make_shared<model::ObservedModel>(*bench.model);
  const Index half = k_case_sensors / 2;
  model::Sensors sensors;
  for (std::size_t i = 0; i < k_case_sensors; ++i)
    sensors.add(bench.sensors.point(i % half), bench.sensors.components[i % half]);
  bench.sensors = sensors;
  twice->space.bottomRows(half) = MatrixXd(twice->space.topRows(half));
  twice->lift.bottomRows(half) = MatrixXd(twice->lift.topRows(half));
  bench.model = twice;
  bench.data.bottomRows(half) = MatrixXd(bench.data.topRows(half));
  expect_named(bench, MisfitCause::single_sensor,
               "12 of 24 sensors have the values of another, to the last digit (sensor ");
  // Of the same places, with noise of their own, they are two measurements.
  bench.data = likelihood::test::synthetic_data(*twice, bench.truth,
                                                bench.noise.measurement().standard_deviations(), 4);
  EXPECT_FALSE(bench.cause());
}

/// What smoothing leaves is small: no other place of a sensor explains it.
TEST(MisfitDiagnosis, SmoothedDataAreNoOrderOfTheSensors) {
  Bench bench;
  const MatrixXd right = bench.data;
  for (Index t = 2; t + 2 < k_case_times; ++t)
    bench.data.col(t) = right.middleCols(t - 2, 5).rowwise().mean();
  const VerdictReason reason = fit_reason(bench);
  ASSERT_TRUE(reason.cause);
  EXPECT_NE(*reason.cause, MisfitCause::sensor_order) << reason.message;
  bench.data.middleRows(3, 2).setConstant(std::nan(""));  // two sensors that are not there are not one twice
  EXPECT_EQ(fit_reason(bench).message.find("count twice"), std::string::npos);
}

/// Moving averages, whose windows are cut off at the ends of the test.
TEST(MisfitDiagnosis, SmoothedDataAreNamedWithTheirWindow) {
  for (const Index half : {2, 3})
    for (unsigned seed = 1; seed <= 4; ++seed) {
      Bench bench(seed);
      const MatrixXd right = bench.data;
      for (Index t = 0; t < k_case_times; ++t) {
        const Index from = std::max<Index>(0, t - half), to = std::min(k_case_times - 1, t + half);
        bench.data.col(t) = right.middleCols(from, to - from + 1).rowwise().mean();
      }
      SCOPED_TRACE(seed);
      expect_named(bench, MisfitCause::smoothing,
                   "the data look smoothed in time, each over about " + std::to_string(2 * half + 1));
      // Noise that is stated as it is after that.
      bench.noise = likelihood::NoiseModel::independent(
          VectorXd::Constant(k_case_sensors, 0.1 / std::sqrt(2.0 * static_cast<double>(half) + 1)));
      expect_named(bench, MisfitCause::smoothing, "the data look smoothed in time");
    }
}

/// A factor that grows from the middle outwards: one factor for all takes little of it away, and is not
/// named.
TEST(MisfitDiagnosis, AFactorThatExplainsLittleIsNotNamed) {
  int seen = 0;
  for (const double at_the_edge : {0.02, 0.03, 0.05, 0.1, 0.2})
    for (unsigned seed = 1; seed <= 6; ++seed) {
      Bench bench(seed);
      for (Index i = 0; i < k_case_sensors; ++i)
        bench.data.row(i) *= 1 + at_the_edge * std::pow(bench.sensors.point(i)[0] / 0.55 - 1, 2);
      const VerdictReason reason = fit_reason(bench);
      seen += reason.cause ? 1 : 0;
      EXPECT_EQ(reason.message.find("model's times 1.0"), std::string::npos) << reason.message;
    }
  EXPECT_GE(seen, 12);
}

/// What another structure adds is no mistake of the measurement.
TEST(MisfitDiagnosis, WhatAnotherModelAddsHasNoNamedCause) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Bench bench;
    const auto other = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                      k_case_sensors, 4, k_case_times, 100 + seed);
    VectorXd more = VectorXd::Zero(k_case_sensors);  // smooth in time, as the data are
    for (Index t = 0; t < k_case_times; ++t) {
      more += 0.1 * other->predict(bench.truth, static_cast<std::size_t>(t));
      bench.data.col(t) += more;
    }
    const VerdictReason reason = fit_reason(bench);
    EXPECT_EQ(reason.level, VerdictLevel::reject);
    EXPECT_EQ(reason.cause, MisfitCause::unknown) << reason.message;
  }
}

}  // namespace
}  // namespace knothe::assimilation
