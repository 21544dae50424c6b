#include "knothe/files/csv.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::files {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(Csv, ReadsByColumnName) {
  const CsvTable table = CsvTable::parse(
      "\xEF\xBB\xBF# made by hand\ntime, sensor ,value\r\n0,\"a \"\"b\"\", c\",1e-3\n\n1,d,\n", "d.csv");
  EXPECT_THAT(table.header(), ElementsAre("time", "sensor", "value"));
  EXPECT_EQ(table.row_count(), 2U);
  EXPECT_THAT(table.numbers("time"), ElementsAre(0.0, 1.0));
  EXPECT_THAT(table.texts("sensor"), ElementsAre("a \"b\", c", "d"));
  EXPECT_TRUE(std::isnan(table.numbers("value", true)[1]));
}

std::string complaint(const std::string& text, const std::string& column) {
  return message_of<DataError>([&] { (void)CsvTable::parse(text, "d.csv").numbers(column); });
}

TEST(Csv, MistakesAreNamedByLineAndColumn) {
  EXPECT_EQ(complaint("a,b\n1,2\n3,4x\n", "b"), "d.csv:3:3: error: column b: \"4x\" is not a number");
  EXPECT_EQ(complaint("a,b\n1,nan\n", "b"), "d.csv:2:3: error: column b: nan is not allowed here");
  EXPECT_EQ(complaint("a,b\n1,2,3\n", "b"), "d.csv:2:5: error: 3 fields, the header has 2");
  EXPECT_EQ(complaint("a,a\n", "a"), "d.csv:1:3: error: column a is there twice");
  EXPECT_EQ(complaint("a\n\"1\n", "a"), "d.csv:2:1: error: a quote that is not closed on this line");
  EXPECT_THAT(complaint("", "a"), HasSubstr("d.csv:1:1: error: the file is empty"));
  EXPECT_THAT(complaint("time,valeu\n", "value"),
              HasSubstr("column value is missing (did you mean \"valeu\"?); there are: time, valeu"));
  EXPECT_THAT(message_of<DataError>([] { (void)CsvTable::read("/none/d.csv"); }), HasSubstr("/none/d.csv"));
  const CsvTable table = CsvTable::parse("a\n\n5\n", "d.csv");
  EXPECT_EQ(message_of<DataError>([&] { table.fail(0, "a", "must be below 4"); }),
            "d.csv:3:1: error: column a: must be below 4");
}

TEST(Csv, WritesWhatItReads) {
  const TestFolder folder;
  CsvWriter writer(std::vector<std::string>{"x", "with, comma"});
  writer.add_row(std::vector<double>{0.1, 1.0 / 3.0});
  writer.add_row(std::vector<double>{-1e-300, 12345678901234567.0});
  writer.write(folder.file("a.csv"));
  const CsvTable table = CsvTable::read(folder.file("a.csv"));
  EXPECT_THAT(table.numbers("x"), ElementsAre(0.1, -1e-300));
  EXPECT_THAT(table.numbers("with, comma"), ElementsAre(1.0 / 3.0, 12345678901234567.0));
}

}  // namespace
}  // namespace knothe::files
