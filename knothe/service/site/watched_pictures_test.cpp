#include "knothe/service/site/watched_pictures.hpp"

#include <gtest/gtest.h>

namespace knothe::service {
namespace {

TEST(WatchedPictures, AFileIsOfTheNearestStep) {
  const std::vector<double> times = {0, 1, 2};
  WatchedPictures pictures(times);
  pictures.show(0.9, "a.png");
  EXPECT_EQ(pictures.of(1), "a.png");
  EXPECT_EQ(pictures.of(2), "");
}

}  // namespace
}  // namespace knothe::service
