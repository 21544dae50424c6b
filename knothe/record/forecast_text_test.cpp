#include "knothe/record/forecast_text.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "knothe/record/physical_parameters.hpp"

namespace knothe::record {
namespace {

TEST(ForecastText, HasAsManyDigitsAsTheStandardDeviationAsksFor) {
  EXPECT_EQ(value_text(-4.012e-4, 1.23e-6, "m"), "−0.4012 ± 0.0012 mm");
  EXPECT_EQ(value_text(0.0412, 0.0013, "m"), "41.2 ± 1.3 mm");
  EXPECT_EQ(value_text(3.21e-6, 4.5e-7, "m"), "3.21 ± 0.45 µm");
  EXPECT_EQ(value_text(1152.34, 0.567, "N"), "1152.34 ± 0.57 N");
  EXPECT_EQ(value_text(1.00123, 0.0034, "1"), "1.0012 ± 0.0034");
  EXPECT_EQ(value_text(2, 0, "N"), "2.000 ± 0 N");
  EXPECT_EQ(value_text(2.002e11, 1.71e9, "Pa"), "200.2 ± 1.7 GPa");
  EXPECT_EQ(value_text(-12345, 678, "N m"), "−12.35 ± 0.68 kN m");
  EXPECT_EQ(value_text(123456, 7890, "m3"), "(1.235 ± 0.079)·10⁵ m3");
}

TEST(ForecastText, WhatWasGivenHasNoMoreDigits) {
  EXPECT_EQ(given_text(0.04, "m"), "40 mm");
  EXPECT_EQ(given_text(12500, "N"), "12.5 kN");
  EXPECT_EQ(given_text(1, ""), "1");
}

TEST(ForecastText, ProbabilitiesAreNeverCertain) {
  EXPECT_EQ(probability_text(4.54e-56), "< 0.1 %");
  EXPECT_EQ(probability_text(1), "> 99.9 %");
  EXPECT_EQ(probability_text(0.1234), "12.3 %");
}

TEST(ForecastText, SaysHorizonThresholdAndBothProbabilities) {
  assimilation::NamedForecast tip;
  tip.name = "tip", tip.units = "m", tip.horizon = 0.3, tip.threshold = -5e-4;
  tip.forecast.mean = -4.012e-4, tip.forecast.std = 1.23e-6, tip.forecast.maximum_a_posteriori = -4.01e-4;
  tip.forecast.values = {-4.036e-4, -4.02e-4, -4.012e-4, -4.004e-4, -3.988e-4};
  tip.forecast.probability_above_threshold = 1;
  EXPECT_EQ(forecast_text(tip, model::Loading{}),
            "tip at time 0.3: −0.4012 ± 0.0012 mm, most probable −0.4010, 95 % in [−0.4036, −0.3988]; "
            "threshold −0.5 mm: P(above) > 99.9 %, P(below) < 0.1 %");
  tip.threshold_stated = false;
  model::Loading stroke{"imposed_displacement", "m", {0, 0.2, 0.4}, {0, 8e-5, 1.6e-4}};
  EXPECT_EQ(forecast_text(tip, stroke),
            "tip at 0.12 mm: −0.4012 ± 0.0012 mm, most probable −0.4010, 95 % in [−0.4036, −0.3988]");
  tip.is_past = true;
  EXPECT_EQ(forecast_text(tip, stroke).substr(0, 52), "tip at 0.12 mm (past: an estimate, not a forecast): ");
}

TEST(ForecastText, AVerdictLeavesAsManyDigitsAsTheWholeUncertainty) {
  assimilation::Verdict verdict;
  verdict.model_shift_std = Eigen::Vector2d(0, 2.4);
  const Precision caution(verdict);  // √(1 + 2.4²) = 2.6
  EXPECT_EQ(value_text(1.00123, caution.of_parameter(0.0034, 0), "1", caution), "1.0012 ± 0.0034");
  EXPECT_EQ(value_text(1.00123, caution.of_parameter(0.0034, 1), "1", caution), "1.0012 ± 0.0088");
  assimilation::NamedForecast tip;
  tip.name = "tip", tip.units = "m", tip.horizon = 0.3, tip.threshold = 0.04, tip.threshold_stated = true;
  tip.forecast.mean = 0.0425804, tip.forecast.std = 2.1e-7, tip.forecast.maximum_a_posteriori = 0.0425804;
  tip.forecast.values = {0.04258, 0.042580, 0.0425804, 0.042581, 0.0425809};
  tip.forecast.probability_above_threshold = 1;
  EXPECT_EQ(forecast_text(tip, model::Loading{}, caution),
            "tip at time 0.3: 42.58040 ± 0.00055 mm, most probable 42.58040, 95 % in [42.58000, 42.58090]; "
            "threshold 40 mm: P(above) > 99.9 %, P(below) < 0.1 %");
  // Of what is rejected, no ± of a millionth and no probability that looks certain.
  verdict.level = assimilation::VerdictLevel::reject;
  EXPECT_EQ(forecast_text(tip, model::Loading{}, Precision(verdict)), "tip at time 0.3: 43 mm (do not use)");
  EXPECT_EQ(value_text(1.4999989, 1.1e-6, "1", Precision(verdict)), "1.5");
  EXPECT_EQ(value_text(836.913, 0.014, "N", Precision(verdict)), "840 N");
}

TEST(ForecastText, HorizonsAreInUnitsOfWhatIsImposedWhereThatRises) {
  const model::Loading force{"force", "N", {0, 1, 2}, {100, 300, 400}};
  EXPECT_EQ(horizon_text(0.5, force), "200 N");
  EXPECT_EQ(horizon_text(0, force), "100 N");
  EXPECT_EQ(horizon_text(2, force), "400 N");
  EXPECT_EQ(horizon_text(2.5, force), "time 2.5");
  EXPECT_EQ(horizon_text(-1, force), "time −1");
  EXPECT_EQ(horizon_text(0.5, model::Loading{"force", "N", {0, 1, 2}, {0, 300, 300}}), "time 0.5");
  EXPECT_EQ(horizon_text(0.5, model::Loading{}), "time 0.5");
  EXPECT_EQ(horizon_text(3600, model::Loading{{}, {}, {0, 3600}, {}, "s"}), "time 3600 s");
}

TEST(PhysicalParameters, UnitsAreThoseOfTheReferenceValue) {
  model::Axis beam{"Y0", {}, "1", "damage threshold Y0, multiple of its reference [J/m3]", 216};
  model::Axis own{"k", {}, "1", "stiffness, multiple of 2e+06 N/m", 2e6};
  EXPECT_EQ(reference_units(beam), "J/m3");
  EXPECT_EQ(reference_units(own), "N/m");
  EXPECT_EQ(reference_units({"p", {}, "Pa", "", 1}), "Pa");
  EXPECT_EQ(reference_units({"p", {}, "1", "something", 3}), "");
  const std::vector<model::Axis> axes = {beam, own};
  const auto record =
      physical_record(axes, Eigen::Vector2d(1.001, 0.5), Eigen::Vector2d(1e-4, 4e-2).asDiagonal());
  EXPECT_DOUBLE_EQ(record["Y0"]["mean"].get<double>(), 216.216);
  EXPECT_DOUBLE_EQ(record["Y0"]["std"].get<double>(), 2.16);
  EXPECT_EQ(record["k"]["units"], "N/m");
  EXPECT_DOUBLE_EQ(record["k"]["std"].get<double>(), 4e5);
}

TEST(PhysicalParameters, WallClockIsIso8601) {
  using namespace std::chrono;
  EXPECT_EQ(utc_text(system_clock::time_point(milliseconds(1763901846123))), "2025-11-23T12:44:06.123Z");
}

}  // namespace
}  // namespace knothe::record
