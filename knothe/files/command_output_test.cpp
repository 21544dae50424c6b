#include "knothe/files/command_output.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"

namespace knothe::files {
namespace {

std::string printed(const CommandOutput& output) {
  testing::internal::CaptureStdout();
  output.line({{"a", 1}, {"b", {0.5, 2}}}, "one line");
  output.line({{"only", true}}, "");
  output.record({{"c", "d"}});
  output.text("");
  return testing::internal::GetCapturedStdout();
}

TEST(CommandOutput, PrintsRecordsForProgramsAndTextForPeople) {
  EXPECT_EQ(printed(CommandOutput(true)), "{\"a\":1,\"b\":[0.5,2]}\n{\"only\":true}\n{\"c\":\"d\"}\n");
  EXPECT_EQ(printed(CommandOutput(false)), "one line\n\n");
}

TEST(CommandOutput, RefusesNumbersThatAreNotFiniteWhereTheyArePrinted) {
  const nlohmann::ordered_json record = {{"a", std::numeric_limits<double>::quiet_NaN()}};
  EXPECT_THROW(CommandOutput(true).record(record), NumericalError);
  EXPECT_NO_THROW(CommandOutput(false).record(record));
}

}  // namespace
}  // namespace knothe::files
