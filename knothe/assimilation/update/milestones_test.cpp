#include "knothe/assimilation/update/milestones.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace knothe::assimilation {
namespace {

TEST(Milestones, OneIsNearWhereverOneGoesBackTo) {
  Milestones<std::size_t> milestones;
  EXPECT_EQ(milestones.last_up_to(7), nullptr);
  const std::size_t n = 1'000'000, apart = Milestones<std::size_t>::k_apart;
  for (std::size_t step = 0; step < n; ++step)
    if (milestones.wants(step)) milestones.save(step, step);
  EXPECT_LE(milestones.size(), 10 * std::log(n));
  for (std::size_t back = 1; back <= n; back += 1 + back / 100) {
    const auto* found = milestones.last_up_to(n - back);
    ASSERT_NE(found, nullptr) << back;
    EXPECT_EQ(found->first, found->second);
    EXPECT_LE(n - back - found->first, back / 3 + 2 * apart) << back;
  }
}

TEST(Milestones, WhatComesAfterAChangeIsForgotten) {
  Milestones<int> milestones;
  for (const std::size_t step : {0, 64, 128, 192}) milestones.save(step, 1);
  EXPECT_FALSE(milestones.wants(255));
  EXPECT_TRUE(milestones.wants(256));
  milestones.forget_after(128);
  EXPECT_EQ(milestones.last_up_to(1000)->first, 128U) << "the state before the step that has changed holds";
  EXPECT_TRUE(milestones.wants(192));
  milestones.clear();
  EXPECT_EQ(milestones.last_up_to(1000), nullptr);
}

}  // namespace
}  // namespace knothe::assimilation
