#include "knothe/service/site/site_health.hpp"

#include <gtest/gtest.h>

namespace knothe::service {
namespace {

MonotonicTime ago(double seconds) {
  return monotonic_now() -
         std::chrono::duration_cast<MonotonicTime::duration>(std::chrono::duration<double>(seconds));
}

TEST(SiteHealth, PeriodAndWhatFollowsFromItAreThoseOfTheLastData) {
  const project::ServeOptions options;
  SiteHealth health(options, false);
  EXPECT_FALSE(health.period_s() || health.stale_after_s() || health.data_age_s());
  EXPECT_EQ(health.budget_s(), 1);
  for (const double at : {100., 50., 49., 48.}) health.accept(ago(at));
  EXPECT_NEAR(*health.period_s(), 1, 0.01);
  EXPECT_NEAR(health.budget_s(), 1, 0.01);
  EXPECT_NEAR(*health.stale_after_s(), 5, 0.05);
  EXPECT_EQ(health.state({}).word, "STALE");
  health.accept(monotonic_now());
  EXPECT_EQ(health.state({}).word, "OK");
}

TEST(SiteHealth, ALineAfterItsBudgetIsAMiss) {
  project::ServeOptions options;
  options.budget = 10;
  SiteHealth health(options, true);
  health.accept(monotonic_now());
  health.await(monotonic_now());
  EXPECT_EQ(health.finish().seconds.size(), 1U);
  EXPECT_EQ(health.deadline_misses(), 0);
  health.await(ago(20));
  EXPECT_EQ(health.state({}).word, "DEGRADED");
  EXPECT_GT(health.finish().seconds.at(0), health.budget_s());
  EXPECT_EQ(health.awaited(), 0U);
  EXPECT_EQ(health.deadline_misses(), 1);
  EXPECT_TRUE(health.missed_strict_deadline());
  EXPECT_EQ(health.state({}).word, "DEGRADED");
}

TEST(SiteHealth, TheFirstStateThatHoldsIsTold) {
  const project::ServeOptions options;
  SiteHealth health(options, false);
  EXPECT_FALSE(health.update_state(health.state({})));  // "no measurement yet" from the start
  health.accept(monotonic_now());
  const auto line = std::make_shared<Line>();
  line->misfit_message = "the data of step 3 do not fit the model";
  EXPECT_EQ(health.state({line, "", false, false}).word, "BIASED");
  EXPECT_EQ(health.state({line, "", true, false}).reason, "the journal is being replayed");
  EXPECT_EQ(health.state({line, "", false, true, "the disk is full"}).reason,
            "measurements are refused, because they cannot be stored: the disk is full");
  EXPECT_EQ(health.state({line, "no", true, true}).word, "DIVERGED");
  EXPECT_TRUE(health.update_state(health.state({line, "no", true, true})));
  EXPECT_EQ(health.state_version(), 1);
}

TEST(SiteHealth, WaitingAndSilenceAreToldApartAndNeverCoverBias) {
  project::ServeOptions options;
  options.stale_after = 5;
  SiteHealth health(options, false);
  const auto told = [&](const SiteHealth::Facts& facts) {
    const SiteHealth::State state = health.state(facts);
    return state.word + " " + state.data_flow + ": " + state.reason;
  };
  const auto fits = std::make_shared<Line>(), biased = std::make_shared<Line>(),
             drifts = std::make_shared<Line>();
  biased->misfit_message = "the data of step 3 do not fit the model";
  drifts->monitor_alarm = true;
  EXPECT_EQ(told({}), "STALE waiting: no measurement yet");
  EXPECT_EQ(told({fits}), "STALE silent: no measurement since the service was started");
  EXPECT_EQ(told({biased}), "BIASED silent: the data of step 3 do not fit the model");
  EXPECT_TRUE(health.update_state(health.state({biased})));
  health.accept(ago(10));
  EXPECT_EQ(told({fits}), "STALE silent: no measurement for more than 5 s");
  EXPECT_EQ(told({biased}), "BIASED silent: the data of step 3 do not fit the model");
  EXPECT_EQ(health.state({drifts}).word, "BIASED");
  EXPECT_EQ(told({biased, "no"}), "DIVERGED silent: the last update failed: no");
  EXPECT_EQ(told({fits, "", false, false, "", "finished by Ada"}), "FINISHED finished: finished by Ada");
  options.stale_after = 3600;
  EXPECT_EQ(told({biased}), "BIASED arriving: the data of step 3 do not fit the model");
  EXPECT_TRUE(health.update_state(health.state({biased}))) << "the word is the same, the flow is not";
  EXPECT_EQ(told({fits}), "OK arriving: ");
}

}  // namespace
}  // namespace knothe::service
