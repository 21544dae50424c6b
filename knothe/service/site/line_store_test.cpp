#include "knothe/service/site/line_store.hpp"

#include <gtest/gtest.h>

#include <array>
#include <string>

namespace knothe::service {
namespace {

std::shared_ptr<Line> line_of(std::size_t step, std::int64_t event) {
  auto line = std::make_shared<Line>();
  line->step = step, line->event = event;
  return line;
}

TEST(LineStore, ALineReplacesThatOfItsStepAndItsEvent) {
  LineStore store(testing::TempDir());
  EXPECT_EQ(store.latest(), nullptr);
  EXPECT_EQ(store.next_line(0), nullptr);
  EXPECT_EQ(store.last_event(), 0);
  store.publish(line_of(1, 10));
  store.publish(line_of(4, 11));
  store.publish(line_of(1, 13));
  EXPECT_EQ(store.latest()->step, 4U);
  EXPECT_EQ(store.line(1)->event, 13);
  EXPECT_EQ(store.line(2), nullptr);
  EXPECT_EQ(store.line_from(0)->step, 1U);
  EXPECT_EQ(store.line_from(2)->step, 4U);
  EXPECT_EQ(store.line_from(5), nullptr);
  using Events = std::vector<std::pair<std::int64_t, std::size_t>>;
  EXPECT_EQ(store.events_from(0), (Events{{13, 1}, {11, 4}}));
  EXPECT_EQ(store.next_line(0)->event, 11);
  EXPECT_EQ(store.next_line(11)->event, 13);
  EXPECT_EQ(store.next_line(13), nullptr);
  EXPECT_EQ(store.last_event(), 13);
}

TEST(LineStore, AWithdrawnLineIsGoneAndReadersHearOfIt) {
  LineStore store(testing::TempDir());
  store.publish(line_of(1, 10));
  store.publish(line_of(4, 11));
  auto gone = std::make_shared<Line>();
  gone->step = 4, gone->event = 12, gone->withdrawn = true;
  store.publish(gone);
  EXPECT_EQ(store.latest()->step, 1U);
  EXPECT_EQ(store.line(4), nullptr);
  EXPECT_EQ(store.line_from(2), nullptr);
  EXPECT_EQ(store.events_from(0).size(), 1U);
  EXPECT_TRUE(store.next_line(10)->withdrawn);
  EXPECT_EQ(store.last_event(), 12);
  store.publish(line_of(4, 13));
  EXPECT_EQ(store.latest()->step, 4U);
  EXPECT_EQ(store.next_line(10)->event, 13);
}

/// Models that nobody looks into.
std::shared_ptr<const ServedModel> model_number(std::size_t i) {
  static const std::array<char, 2> places{};
  const void* place = &places[i];
  return {std::shared_ptr<void>(), static_cast<const ServedModel*>(place)};
}

/// A line with something in every member.
std::shared_ptr<Line> full_line(std::size_t step, std::int64_t event) {
  auto line = line_of(step, event);
  const double x = static_cast<double>(event);
  line->time = 0.1 * x;
  line->json = "{\"event\":" + std::to_string(event) + "}" + std::string(event % 7 * 100, ' ');
  line->mean = Eigen::Vector2d(x, 2 * x), line->std = Eigen::Vector2d(3, x);
  line->samples = Eigen::MatrixXd::Constant(5, 2, x);
  line->missing = {true, false, event % 2 == 0};
  line->residual = Eigen::Vector3d(0, x, 1);
  line->above_threshold = {{"crack", 0.25}, {"force", x}};
  line->trusted = step % 3 != 0;
  line->remark = "remark", line->verdict_message = "verdict", line->misfit_message = "misfit";
  line->verdict = assimilation::VerdictLevel::reject;
  line->misfit = {x, 60, 0.5};
  line->monitor_alarm = line->bias_corrected = line->model_doubted = true;
  line->stuck = {1, 2}, line->absent = {3};
  line->notice = "notice";
  line->bias = {Eigen::Vector2d(x, 0), Eigen::Vector3d(0, 0, x)};
  line->model = model_number(step % 2);
  return line;
}

void expect_same(const Line& a, const Line& b) {
  EXPECT_EQ(a.event, b.event);
  EXPECT_EQ(a.step, b.step);
  EXPECT_EQ(a.time, b.time);
  EXPECT_EQ(a.withdrawn, b.withdrawn);
  EXPECT_EQ(a.json, b.json);
  EXPECT_EQ(a.mean, b.mean);
  EXPECT_EQ(a.std, b.std);
  EXPECT_EQ(a.samples, b.samples);
  EXPECT_EQ(a.missing, b.missing);
  EXPECT_EQ(a.residual, b.residual);
  EXPECT_EQ(a.above_threshold, b.above_threshold);
  EXPECT_EQ(a.trusted, b.trusted);
  EXPECT_EQ(a.remark, b.remark);
  EXPECT_EQ(a.verdict, b.verdict);
  EXPECT_EQ(a.verdict_message, b.verdict_message);
  EXPECT_EQ(a.misfit.statistic, b.misfit.statistic);
  EXPECT_EQ(a.misfit.values, b.misfit.values);
  EXPECT_EQ(a.misfit.probability, b.misfit.probability);
  EXPECT_EQ(a.misfit_message, b.misfit_message);
  EXPECT_EQ(a.monitor_alarm, b.monitor_alarm);
  EXPECT_EQ(a.bias_corrected, b.bias_corrected);
  EXPECT_EQ(a.stuck, b.stuck);
  EXPECT_EQ(a.absent, b.absent);
  EXPECT_EQ(a.notice, b.notice);
  EXPECT_EQ(a.bias.functions, b.bias.functions);
  EXPECT_EQ(a.bias.sensors, b.bias.sensors);
  EXPECT_EQ(a.model_doubted, b.model_doubted);
  EXPECT_EQ(a.model, b.model);
}

TEST(LineStore, OldLinesAreReadBackFromTheFileAsTheyWere) {
  LineStore store(testing::TempDir());
  const std::size_t steps = 3 * LineStore::k_in_memory;
  std::int64_t event = 1;
  for (int round = 0; round < 5; ++round)  // each line is replaced, most by one of another length
    for (std::size_t step = 0; step < steps; ++step) store.publish(full_line(step, event++));
  EXPECT_EQ(store.in_memory(), LineStore::k_in_memory);
  const std::int64_t first = event - static_cast<std::int64_t>(steps);
  std::int64_t seen = 0;
  for (std::size_t step = 0; step < steps; ++step) {
    const auto expected = full_line(step, first + static_cast<std::int64_t>(step));
    expect_same(*store.line(step), *expected);
    const auto next = store.next_line(seen);
    expect_same(*next, *expected);
    seen = next->event;
  }
  EXPECT_EQ(store.next_line(seen), nullptr);
  auto gone = line_of(3, event);
  gone->withdrawn = true;
  store.publish(gone);
  EXPECT_EQ(store.line(3), nullptr);
  EXPECT_EQ(store.line_from(3)->step, 4U);
}

TEST(LineStore, TheLatestLineIsThatOfTheLastStepHoweverOldItIs) {
  LineStore store(testing::TempDir());
  const std::size_t last = 2 * LineStore::k_in_memory;
  store.publish(full_line(last + 1, 1));
  store.publish(full_line(last, 2));
  for (std::size_t step = 0; step < last; ++step)
    store.publish(full_line(step, 3 + static_cast<std::int64_t>(step)));
  expect_same(*store.latest(), *full_line(last + 1, 1));
  auto gone = line_of(last + 1, 10'000);
  gone->withdrawn = true;
  store.publish(gone);
  expect_same(*store.latest(), *full_line(last, 2));
}

TEST(LineStore, TheLastUntrustedStepsAreKnown) {
  LineStore store(testing::TempDir());
  EXPECT_TRUE(store.untrusted().empty());
  const auto publish = [&](std::size_t step, bool trusted) {
    auto line = line_of(step, store.last_event() + 1);
    line->trusted = trusted;
    store.publish(line);
  };
  publish(2, false);
  publish(5, false);
  publish(3, true);
  EXPECT_EQ(store.untrusted(), (std::vector<std::size_t>{2, 5}));
  publish(2, true);
  EXPECT_EQ(store.untrusted(), std::vector<std::size_t>{5});
  for (std::size_t step = 0; step < LineStore::k_untrusted + 10; ++step) publish(step, false);
  EXPECT_EQ(store.untrusted().size(), LineStore::k_untrusted);
  EXPECT_EQ(store.untrusted().front(), 10U);
}

TEST(LineStore, WithoutAFileAllLinesStayInMemory) {
  LineStore store("/nowhere/at/all");
  const std::size_t steps = 2 * LineStore::k_in_memory;
  for (std::size_t step = 0; step < steps; ++step)
    store.publish(full_line(step, 1 + static_cast<std::int64_t>(step)));
  EXPECT_EQ(store.in_memory(), steps);
  expect_same(*store.line(0), *full_line(0, 1));
}

}  // namespace
}  // namespace knothe::service
