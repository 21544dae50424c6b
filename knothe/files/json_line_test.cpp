#include "knothe/files/json_line.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"

namespace knothe::files {
namespace {

TEST(JsonLine, NumbersReadBackToTheSameDouble) {
  for (double value : {0.1, 1.0 / 3, 5e-324, 1.7976931348623157e308, -4.2e-6, 1e22}) {
    EXPECT_EQ(nlohmann::json::parse(json_line({{"v", value}}))["v"].get<double>(), value);
  }
}

TEST(JsonLine, NonFiniteNumbersAreRefusedByName) {
  const nlohmann::ordered_json line = {{"a", 1},
                                       {"b", {{"c", {1.0, std::numeric_limits<double>::quiet_NaN()}}}}};
  try {
    (void)json_line(line);
    FAIL();
  } catch (const NumericalError& error) {
    EXPECT_STREQ(error.what(), "the result \"b.c[1]\" is not finite; it is not printed");
  }
}

}  // namespace
}  // namespace knothe::files
