#include "knothe/posterior/trust.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior {
namespace {

TEST(Trust, AllThreeMustHold) {
  EXPECT_TRUE(trust_of(MapFigures{0.05, 0.9, false, ""}).trusted);
  EXPECT_EQ(trust_of(MapFigures{0.05, 0.9, false, ""}).reason, "");
  EXPECT_FALSE(trust_of(MapFigures{0.051, 1, false, ""}).trusted);
  EXPECT_FALSE(trust_of(MapFigures{0, 0.899, false, ""}).trusted);
  EXPECT_FALSE(trust_of(MapFigures{0, 1, true, "a second mode"}).trusted);
}

TEST(Trust, TheReasonIsInWords) {
  EXPECT_EQ(trust_of(MapFigures{0.2, 0.75, true, "a second mode was found at z = (1, 2)"}).reason,
            "the variance diagnostic on independent points is 0.2, above 0.05; the effective sample size is "
            "75 % of "
            "the points, below 90 %; a second mode was found at z = (1, 2)");
}

TEST(Trust, TemperingThatStoppedIsNotSaidToBeAtItsEnd) {
  ImportanceResult draws;
  draws.mean_error = draws.deviation_error = 1;
  EXPECT_EQ(
      trust_of(draws, 0.999).reason,
      "tempering stopped before the posterior, at temperature 0.99 of 1; raise evaluations, or use method "
      "mcmc");
}

TEST(Trust, WhatIsNotANumberIsNotTrusted) {
  EXPECT_FALSE(trust_of(MapFigures{std::nan(""), 1, false, ""}).trusted);
  EXPECT_FALSE(trust_of(MapFigures{0, std::nan(""), false, ""}).trusted);
}

}  // namespace
}  // namespace knothe::posterior
