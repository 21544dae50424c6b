#include "knothe/service/camera/frame_numbers.hpp"

#include <gtest/gtest.h>

namespace knothe::service {
namespace {

using By = FrameNumbers::Place::By;

constexpr double k_period = 0.1;
constexpr std::int64_t k_period_us = 100'000, k_host = 1'700'000'000'000'000, k_camera = 5'000'000;

/// The frame that a camera takes `k` periods after it was switched on, both clocks exact.
FrameStamp stamp_of(std::int64_t k) {
  return {k_camera + k * k_period_us, k_host + k * k_period_us, static_cast<std::uint64_t>(k + 1)};
}

FrameNumbers connected(std::optional<double> period = k_period) {
  FrameNumbers numbers(std::nullopt);
  numbers.begin("A1", period);
  return numbers;
}

TEST(FrameNumbers, FramesAreCountedFromTheFirst) {
  FrameNumbers numbers = connected();
  for (std::int64_t k = 40; k < 45; ++k) {
    const auto place = numbers.place(stamp_of(k));
    ASSERT_TRUE(place);
    EXPECT_EQ(place->frame.number, k - 40);
    EXPECT_EQ(place->frame.session, "A1");
    EXPECT_EQ(place->absent, 0);
  }
}

TEST(FrameNumbers, FramesBeforeTheFirstWholeOneCount) {
  FrameNumbers numbers = connected();
  numbers.skip(2);
  EXPECT_EQ(numbers.place(stamp_of(2))->frame.number, 2);
  numbers.skip(1);  // from now on the clock tells
  EXPECT_EQ(numbers.place(stamp_of(4))->frame.number, 4);
}

TEST(FrameNumbers, AFrameThatDidNotComeLeavesItsNumberOut) {
  FrameNumbers numbers = connected();
  (void)numbers.place(stamp_of(0));
  const auto before = *numbers.last();
  const auto place = numbers.place(stamp_of(3));
  ASSERT_TRUE(place);
  EXPECT_EQ(place->frame.number, 3);
  EXPECT_EQ(place->absent, 2);
  EXPECT_TRUE(place->connected);
  EXPECT_EQ(FrameNumbers::absent(*place, before, 2).number, 2);
  EXPECT_EQ(FrameNumbers::absent(*place, before, 2).camera_us, stamp_of(2).camera_us);
}

TEST(FrameNumbers, AFrameThatIsKnownIsNotTakenAgain) {
  FrameNumbers numbers = connected();
  (void)numbers.place(stamp_of(0));
  (void)numbers.place(stamp_of(1));
  EXPECT_FALSE(numbers.place(stamp_of(1)));
  EXPECT_FALSE(numbers.place(stamp_of(0)));
  FrameStamp early = stamp_of(1);
  early.camera_us += k_period_us / 3;
  EXPECT_FALSE(numbers.place(early));
  EXPECT_EQ(numbers.place(stamp_of(2))->frame.number, 2);
}

TEST(FrameNumbers, AClockThatDriftsLosesNoFrame) {
  FrameNumbers numbers = connected();
  for (std::int64_t k = 0; k < 100'000; ++k) {  // 100 ppm: ten frames over all
    FrameStamp stamp = stamp_of(k);
    stamp.camera_us += k * k_period_us / 10'000;
    ASSERT_EQ(numbers.place(stamp)->frame.number, k);
  }
}

TEST(FrameNumbers, AfterARestartTheCamerasClockTellsTheNumber) {
  const FrameStamp last = stamp_of(49);
  FrameNumbers numbers(FrameNumbers::Numbered{49, "A1", last.camera_us, last.host_us + 80'000});
  numbers.begin("A1", k_period);
  EXPECT_FALSE(numbers.place(last));
  const auto place = numbers.place(stamp_of(63));
  ASSERT_TRUE(place);
  EXPECT_EQ(place->frame.number, 63);
  EXPECT_EQ(place->absent, 13);
  EXPECT_FALSE(place->connected);
  EXPECT_EQ(place->by, By::camera_clock);
}

TEST(FrameNumbers, AClockThatBeganAnewIsReplacedByThisMachines) {
  FrameNumbers numbers = connected();
  for (std::int64_t k = 0; k < 5; ++k) (void)numbers.place(stamp_of(k));
  numbers.begin("A1", k_period);
  FrameStamp stamp = stamp_of(300);
  stamp.camera_us = 7, stamp.id = 1;
  const auto place = numbers.place(stamp);
  ASSERT_TRUE(place);
  EXPECT_EQ(place->frame.number, 300);
  EXPECT_EQ(place->frame.session, "A1.300");
  EXPECT_EQ(place->by, By::host_clock);
  stamp.camera_us += k_period_us, stamp.host_us += k_period_us;
  EXPECT_EQ(numbers.place(stamp)->frame.session, "A1.300");
}

TEST(FrameNumbers, AnotherCameraHasAnotherClock) {
  FrameNumbers numbers = connected();
  (void)numbers.place(stamp_of(0));
  numbers.begin("A12", k_period);
  const auto place = numbers.place(stamp_of(8));
  EXPECT_EQ(place->frame.number, 8);
  EXPECT_EQ(place->frame.session, "A12.8");
}

TEST(FrameNumbers, WithoutARateFramesAreCountedByTheirIds) {
  FrameNumbers numbers = connected(std::nullopt);
  FrameStamp stamp{10, k_host, 65533};
  EXPECT_EQ(numbers.place(stamp)->frame.number, 0);
  stamp.camera_us += 9'000'000, stamp.host_us += 9'000'000, stamp.id = 65535;
  EXPECT_EQ(numbers.place(stamp)->frame.number, 2);
  stamp.camera_us += 10, stamp.id = 1;
  EXPECT_EQ(numbers.place(stamp)->frame.number, 3);
  EXPECT_FALSE(numbers.place(stamp));
}

TEST(FrameNumbers, WithoutARateNumbersGoOnAfterARestart) {
  FrameNumbers numbers(FrameNumbers::Numbered{7, "A1", 1'000'000, k_host});
  numbers.begin("A1", std::nullopt);
  EXPECT_FALSE(numbers.place({1'000'000, k_host, 9}));
  const auto place = numbers.place({2'000'000, k_host + 1'000'000, 3});
  EXPECT_EQ(place->frame.number, 8);
  EXPECT_EQ(place->by, By::order);
  EXPECT_FALSE(place->connected);
}

}  // namespace
}  // namespace knothe::service
