#include "knothe/files/numbers.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <random>

namespace knothe::files {
namespace {

TEST(Numbers, EveryDoubleReadsBackToTheSameBits) {
  std::mt19937_64 random(1);
  for (int i = 0; i < 20000; ++i) {
    const double value = std::bit_cast<double>(random());
    if (!std::isfinite(value)) continue;
    const auto back = parse_number(format_number(value));
    ASSERT_TRUE(back.has_value()) << format_number(value);
    ASSERT_EQ(std::bit_cast<std::uint64_t>(*back), std::bit_cast<std::uint64_t>(value));
  }
  EXPECT_EQ(format_number(0.1), "0.1");
  EXPECT_EQ(format_number(-3.0), "-3");
}

TEST(Numbers, OnlyWholeNumbersAreAccepted) {
  EXPECT_EQ(parse_number(" +1.5e-3\t"), 1.5e-3);
  EXPECT_TRUE(std::isnan(*parse_number("NaN")));
  for (const char* text : {"", "  ", "1.5x", "1,5", "x", "1 2", "--1"}) {
    EXPECT_FALSE(parse_number(text).has_value()) << text;
  }
}

}  // namespace
}  // namespace knothe::files
