#include "knothe/service/site/site_alarms.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::service {
namespace {

std::string without_time(const Alarm& alarm) {
  Json json = json_of(alarm);
  EXPECT_GT(json["raised_at"].get<double>(), 1.7e9);
  json.erase("raised_at");
  return json.dump();
}

TEST(SiteAlarms, AConditionIsToldWhenItBeginsAndIdsAreSharedWithLines) {
  std::atomic<std::int64_t> next_event{7};
  std::vector<assimilation::ForecastSpecification> forecasts(1);
  forecasts[0].name = "opening", forecasts[0].threshold = 1;
  SiteAlarms alarms(forecasts, next_event, [](const Alarm&) {});
  Line line;
  alarms.update_conditions(line);
  EXPECT_TRUE(alarms.after(0).empty());
  line.step = 3;
  line.above_threshold["opening"] = 0.1;
  alarms.update_conditions(line);
  alarms.update_conditions(line);
  next_event++;  // a line
  line.above_threshold["opening"] = 0.6;
  alarms.update_conditions(line);
  const auto told = alarms.after(0);
  ASSERT_EQ(told.size(), 2U);
  EXPECT_EQ(
      without_time(told[0]),
      R"({"id":7,"step":3,"severity":"warning","kind":"threshold","message":"P(opening > 1) is 10 %"})");
  EXPECT_EQ(told[1].id, 9);
  EXPECT_EQ(told[1].severity, "alarm");
  EXPECT_EQ(alarms.after(7).size(), 1U);
}

TEST(SiteAlarms, WhatThePriorAloneSaysOfAThresholdIsNoAlarm) {
  std::atomic<std::int64_t> next_event{1};
  std::vector<assimilation::ForecastSpecification> forecasts(1);
  forecasts[0].name = "opening", forecasts[0].threshold = 1;
  SiteAlarms alarms(forecasts, next_event, [](const Alarm&) {});
  Line line;
  line.above_threshold["opening"] = 0.9;
  alarms.update_conditions(line, false);
  EXPECT_TRUE(alarms.after(0).empty());
  alarms.update_conditions(line, true);
  EXPECT_EQ(alarms.after(0).size(), 1U);
  alarms.update_conditions(line, false);  // a posterior that comes near to the prior again
  alarms.update_conditions(line, true);
  EXPECT_EQ(alarms.after(0).size(), 1U);
}

TEST(SiteAlarms, ALineIsInformedOnceItsDrawsAreNotThoseOfThePriors) {
  const std::vector<posterior::Prior> priors = {posterior::Prior::uniform(2, 4),
                                                posterior::Prior::normal(0.9, 0.4).truncated(0.5, 1.5, "b")};
  const auto drawn = [&](double from, double to, Eigen::Index column) {
    Line line;
    line.samples.resize(100, 2);
    for (Eigen::Index i = 0; i < 100; ++i)
      for (Eigen::Index k = 0; k < 2; ++k) {
        const double share = (i + 0.5) / 100, part = k == column ? from + (to - from) * share : share;
        line.samples(i, k) = priors[k].from_standard_normal(numerics::normal_quantile(part)).value;
      }
    return line;
  };
  EXPECT_FALSE(is_informed(drawn(0, 1, 0), priors));
  for (const Eigen::Index column : {0, 1}) {
    EXPECT_FALSE(is_informed(drawn(0, 0.95, column), priors));
    EXPECT_TRUE(is_informed(drawn(0.25, 0.75, column), priors));  // narrower
    EXPECT_TRUE(is_informed(drawn(0.3, 1, column), priors));      // elsewhere
  }
}

TEST(SiteAlarms, ALoosePlugDoesNotPushOutWhatTheStructureHadToSay) {
  std::atomic<std::int64_t> next_event{1};
  const std::vector<assimilation::ForecastSpecification> forecasts;
  std::vector<Alarm> kept;
  SiteAlarms alarms(forecasts, next_event, [&](const Alarm& alarm) { kept.push_back(alarm); });
  alarms.raise(0, "alarm", "verdict", "reject");
  alarms.raise(1, "warning", "threshold", "P is 0.1");
  for (std::size_t step = 2; step < 1000; ++step) alarms.raise(step, "alarm", "sensors", "in quarantine");
  alarms.raise(1000, "alarm", "bias", "the model does not explain the data");
  SiteAlarms again(forecasts, next_event, [](const Alarm&) {});
  again.restore(kept, {});
  for (const SiteAlarms* site : {&alarms, &again}) {
    const auto told = site->after(0);
    ASSERT_EQ(told.size(), SiteAlarms::k_kept);
    EXPECT_EQ(told[0].kind, "verdict");
    EXPECT_EQ(told[1].kind, "threshold");
    EXPECT_EQ(told[2].step, 1000 - static_cast<std::int64_t>(SiteAlarms::k_kept) + 3);
    EXPECT_EQ(told.back().kind, "bias");
  }
}

TEST(SiteAlarms, TheVerdictIsToldWhenItsLevelChangesForTheWorse) {
  std::atomic<std::int64_t> next_event{1};
  const std::vector<assimilation::ForecastSpecification> forecasts;
  SiteAlarms alarms(forecasts, next_event, [](const Alarm&) {});
  Line line;
  using Level = assimilation::VerdictLevel;
  for (const Level level :
       {Level::ok, Level::caution, Level::caution, Level::reject, Level::ok, Level::reject}) {
    line.verdict = level;
    line.verdict_message = "because of " + to_text(level);
    alarms.update_conditions(line);
    ++line.step;
  }
  const auto told = alarms.after(0);
  ASSERT_EQ(told.size(), 3U);
  EXPECT_EQ(without_time(told[0]),
            R"({"id":1,"step":1,"severity":"warning","kind":"verdict","message":"because of caution"})");
  EXPECT_EQ(told[1].severity, "alarm");
  EXPECT_EQ(told[1].step, 3U);
  EXPECT_EQ(told[2].step, 5U);
}

TEST(SiteAlarms, WhatHeldBeforeARestartIsNotToldAgain) {
  std::atomic<std::int64_t> next_event{1};
  const std::vector<assimilation::ForecastSpecification> forecasts;
  std::vector<Alarm> kept;
  const auto store = [&](const Alarm& alarm) { kept.push_back(alarm); };
  Line line;
  line.verdict = assimilation::VerdictLevel::reject, line.trusted = false, line.remark = "too wide";
  SiteAlarms before(forecasts, next_event, store);
  before.update_conditions(line);
  line.trusted = true;
  before.update_conditions(line);
  ASSERT_EQ(kept.size(), 3U);  // verdict and trust, and that trust is there again
  EXPECT_EQ(kept[2].severity, "");
  EXPECT_EQ(before.after(0).size(), 2U);
  SiteAlarms alarms(forecasts, next_event, store);
  alarms.restore(before.after(0), kept);
  alarms.update_conditions(line);
  EXPECT_EQ(alarms.after(0).size(), 2U);
  line.trusted = false;
  alarms.update_conditions(line);
  ASSERT_EQ(alarms.after(0).size(), 3U);
  EXPECT_EQ(alarms.after(0)[2].message, "too wide");
}

TEST(SiteAlarms, TheLast256AreKept) {
  std::atomic<std::int64_t> next_event{1};
  const std::vector<assimilation::ForecastSpecification> forecasts;
  SiteAlarms alarms(forecasts, next_event, [](const Alarm&) {});
  for (int i = 0; i < 300; ++i) alarms.raise(0, "info", "trust", "");
  EXPECT_EQ(alarms.after(0).size(), 256U);
  EXPECT_EQ(alarms.after(0).back().id, 300);
}

}  // namespace
}  // namespace knothe::service
