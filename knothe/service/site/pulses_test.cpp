#include "knothe/service/site/pulses.hpp"

#include <gtest/gtest.h>

namespace knothe::service {
namespace {

TEST(Pulses, AThreadThatDoesNotMoveOnIsNamed) {
  Pulses pulses;
  const auto start = monotonic_now();
  const auto after = [&](int seconds) { return start + std::chrono::seconds(seconds); };
  const auto folders = pulses.add("the watch of folders", 60);
  auto commits = pulses.add("the journal's thread", 30);
  EXPECT_EQ(pulses.complaint(after(1'000)), "") << "they wait for work";
  folders->beat(start);
  commits->beat(start);
  EXPECT_EQ(pulses.complaint(after(30)), "");
  EXPECT_EQ(pulses.complaint(after(40)), "the journal's thread has not moved on for 40 s");
  EXPECT_EQ(pulses.complaint(after(61)),
            "the watch of folders has not moved on for 61 s; the journal's thread has not moved on for 61 s");
  folders->beat(after(50));
  commits->rest();
  EXPECT_EQ(pulses.complaint(after(61)), "");
  commits->beat(after(61));
  commits.reset();
  EXPECT_EQ(pulses.complaint(after(100)), "") << "it has ended in order";
}

}  // namespace
}  // namespace knothe::service
