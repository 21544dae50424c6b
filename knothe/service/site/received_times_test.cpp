#include "knothe/service/site/received_times.hpp"

#include <gtest/gtest.h>

namespace knothe::service {
namespace {

TEST(ReceivedTimes, TheLastOfAStepWhateverCameAndWent) {
  ReceivedTimes times;
  times.add(3, 30);
  times.add(1, 12);
  times.add(3, 20);
  times.add(1, 11);
  times.add(3, 30);
  EXPECT_EQ(times.last(1), 12);
  EXPECT_EQ(times.last(3), 30);
  times.remove(3, 30);
  EXPECT_EQ(times.last(3), 30);
  times.remove(3, 30);
  EXPECT_EQ(times.last(3), 20);
  times.remove(1, 12);
  EXPECT_EQ(times.last(1), 11);
}

}  // namespace
}  // namespace knothe::service
