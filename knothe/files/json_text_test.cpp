#include "knothe/files/json_text.hpp"

#include <gtest/gtest.h>

#include <array>
#include <nlohmann/json.hpp>
#include <string>

#include "knothe/base/error.hpp"

namespace knothe::files {
namespace {

std::string repeated(const std::string& part, int times) {
  std::string all;
  for (int i = 0; i < times; ++i) all += part;
  return all;
}

std::string refusal(const std::string& text) {
  try {
    (void)parse_json(text);
  } catch (const DataError& error) {
    return error.what();
  }
  return "";
}

TEST(JsonText, IsReadAsItIsWritten) {
  const std::string text =
      R"({"b":[1,2.5e-300,null,{"x":true}],"a":"ü","c":{"x":1,"b":2},"d":[{"x":1},{"x":2}]})";
  EXPECT_EQ(parse_json(text), nlohmann::json::parse(text));
  EXPECT_EQ(parse_json("3"), 3);
}

/// In a time that goes with their number: compared each with all others they would take an hour.
TEST(JsonText, ManyObjectsSideBySideAreRead) {
  EXPECT_EQ(parse_json("[" + repeated("{},", 500'000) + "1]").size(), 500'001);
  std::string object = "{";
  for (int i = 0; i < 200'000; ++i) object += "\"" + std::to_string(i) + "\":{},";
  EXPECT_EQ(parse_json(object + "\"z\":[{}]}").size(), 200'001);
}

TEST(JsonText, IsRefusedWhereItIsNestedTooDeep) {
  for (const auto& [open, inside, close] : {std::array{"[", "", "]"}, {"{\"a\":", "1", "}"}}) {
    const auto nested = [&](int depth) { return repeated(open, depth) + inside + repeated(close, depth); };
    EXPECT_EQ(refusal(nested(k_deepest_json)), "");
    EXPECT_EQ(refusal(nested(k_deepest_json + 1)), "it is nested deeper than 64 levels");
    EXPECT_EQ(refusal(nested(1'000'000)), "it is nested deeper than 64 levels");
  }
}

TEST(JsonText, IsRefusedWhereAKeyComesTwice) {
  EXPECT_EQ(refusal(R"({"a":{"seq":1},"b":[{"seq":1,"x":0,"s\u0065q":2}]})"),
            "\"seq\" comes twice in one object");
  EXPECT_EQ(refusal(R"({"a":{"a":{"a":1}}})"), "");
}

TEST(JsonText, IsRefusedWhereItIsNoJson) {
  for (const char* text : {"", "{", "[1,]", "nan", "1 2", "\"\xff\"", "{\"a\":1e999}"})
    EXPECT_NE(refusal(text), "") << text;
}

}  // namespace
}  // namespace knothe::files
