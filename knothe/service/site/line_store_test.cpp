#include "knothe/service/site/line_store.hpp"

#include <gtest/gtest.h>

namespace knothe::service {
namespace {

std::shared_ptr<Line> line_of(std::size_t step, std::int64_t event) {
  auto line = std::make_shared<Line>();
  line->step = step, line->event = event;
  return line;
}

TEST(LineStore, ALineReplacesThatOfItsStepAndItsEvent) {
  LineStore store;
  EXPECT_EQ(store.latest(), nullptr);
  EXPECT_EQ(store.next_line(0), nullptr);
  EXPECT_EQ(store.last_event(), 0);
  store.publish(line_of(1, 10));
  store.publish(line_of(4, 11));
  store.publish(line_of(1, 13));
  EXPECT_EQ(store.latest()->step, 4U);
  EXPECT_EQ(store.line(1)->event, 13);
  EXPECT_EQ(store.line(2), nullptr);
  ASSERT_EQ(store.lines(0).size(), 2U);
  EXPECT_EQ(store.lines(2).front()->step, 4U);
  EXPECT_EQ(store.next_line(0)->event, 11);
  EXPECT_EQ(store.next_line(11)->event, 13);
  EXPECT_EQ(store.next_line(13), nullptr);
  EXPECT_EQ(store.last_event(), 13);
}

TEST(LineStore, AWithdrawnLineIsGoneAndReadersHearOfIt) {
  LineStore store;
  store.publish(line_of(1, 10));
  store.publish(line_of(4, 11));
  auto gone = std::make_shared<Line>();
  gone->step = 4, gone->event = 12, gone->withdrawn = true;
  store.publish(gone);
  EXPECT_EQ(store.latest()->step, 1U);
  EXPECT_EQ(store.line(4), nullptr);
  EXPECT_EQ(store.lines(0).size(), 1U);
  EXPECT_TRUE(store.next_line(10)->withdrawn);
  EXPECT_EQ(store.last_event(), 12);
  store.publish(line_of(4, 13));
  EXPECT_EQ(store.latest()->step, 4U);
  EXPECT_EQ(store.next_line(10)->event, 13);
}

}  // namespace
}  // namespace knothe::service
