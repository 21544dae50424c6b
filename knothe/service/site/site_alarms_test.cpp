#include "knothe/service/site/site_alarms.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace knothe::service {
namespace {

TEST(SiteAlarms, AConditionIsToldWhenItBeginsAndIdsAreSharedWithLines) {
  std::atomic<std::int64_t> next_event{7};
  std::vector<forecast::ForecastSpecification> forecasts(1);
  forecasts[0].name = "opening", forecasts[0].threshold = 1;
  SiteAlarms alarms(forecasts, next_event);
  Line line;
  alarms.judge(line);
  EXPECT_TRUE(alarms.after(0).empty());
  line.step = 3;
  line.above_threshold["opening"] = 0.1;
  alarms.judge(line);
  alarms.judge(line);
  next_event++;  // a line
  line.above_threshold["opening"] = 0.6;
  alarms.judge(line);
  const auto told = alarms.after(0);
  ASSERT_EQ(told.size(), 2U);
  EXPECT_EQ(told[0].json().dump(),
            R"({"id":7,"step":3,"severity":"warning","kind":"threshold","message":"P(opening > 1) is 0.1"})");
  EXPECT_EQ(told[1].id, 9);
  EXPECT_EQ(told[1].severity, "alarm");
  EXPECT_EQ(alarms.after(7).size(), 1U);
}

TEST(SiteAlarms, TheVerdictIsToldWhenItsLevelChangesForTheWorse) {
  std::atomic<std::int64_t> next_event{1};
  const std::vector<forecast::ForecastSpecification> forecasts;
  SiteAlarms alarms(forecasts, next_event);
  Line line;
  using Level = assimilation::VerdictLevel;
  for (const Level level :
       {Level::ok, Level::caution, Level::caution, Level::reject, Level::ok, Level::reject}) {
    line.verdict = level;
    line.verdict_message = "because of " + to_text(level);
    alarms.judge(line);
    ++line.step;
  }
  const auto told = alarms.after(0);
  ASSERT_EQ(told.size(), 3U);
  EXPECT_EQ(told[0].json().dump(),
            R"({"id":1,"step":1,"severity":"warning","kind":"verdict","message":"because of caution"})");
  EXPECT_EQ(told[1].severity, "alarm");
  EXPECT_EQ(told[1].step, 3U);
  EXPECT_EQ(told[2].step, 5U);
}

TEST(SiteAlarms, TheLast256AreKept) {
  std::atomic<std::int64_t> next_event{1};
  const std::vector<forecast::ForecastSpecification> forecasts;
  SiteAlarms alarms(forecasts, next_event);
  for (int i = 0; i < 300; ++i) alarms.raise(0, "info", "trust", "");
  EXPECT_EQ(alarms.after(0).size(), 256U);
  EXPECT_EQ(alarms.after(0).back().id, 300);
}

}  // namespace
}  // namespace knothe::service
