#include "knothe/project/option_section.hpp"

#include <gtest/gtest.h>

namespace knothe::project {
namespace {

enum class Colour { red, green };

constexpr auto names_of(Colour /*colour*/) {
  return std::to_array<Named<Colour>>({{Colour::red, "red"}, {Colour::green, "green"}});
}

/// Options of every type, read where [model] has keys of the right kind.
struct Sample {
  double timeout = 2.5e-7;
  int connections = 3;
  std::optional<double> difference_step;
  std::string name = "nobody";
  Colour kind = Colour::green;
  bool derivatives = true;
};

Section<Sample> sample_section() {
  Section<Sample> s("model");
  s.add("timeout", &Sample::timeout, "Number.", positive);
  s.add("connections", &Sample::connections, "Whole number.", at_least(2), at_most(64));
  s.add("difference_step", &Sample::difference_step, "Number or nothing.",
        check([](double v) { return v < 1; }, "\"{}\" is not below 1"));
  s.add("name", &Sample::name, "Text.");
  s.add("kind", &Sample::kind, "Word.");
  s.choice("derivatives", &Sample::derivatives, "none", "all", "No or yes.");
  return s;
}

TEST(OptionSection, PrintsTheDefaultsOfTheStruct) {
  const Section<Sample> section = sample_section();
  std::vector<std::string> defaults;
  for (const Option& option : section.options()) defaults.push_back(option.default_value);
  EXPECT_EQ(defaults, (std::vector<std::string>{"2.5e-7", "3", "", "\"nobody\"", "\"green\"", "\"all\""}));
}

TEST(OptionSection, AnEmptyFileGivesTheDefaults) {
  Values values = parse_values("", "");
  const Sample s = sample_section().read(values);
  EXPECT_EQ(s.timeout, 2.5e-7);
  EXPECT_EQ(s.connections, 3);
  EXPECT_FALSE(s.difference_step);
  EXPECT_EQ(s.name, "nobody");
  EXPECT_EQ(s.kind, Colour::green);
  EXPECT_TRUE(s.derivatives);
}

TEST(OptionSection, WhatIsWrittenTakesTheirPlace) {
  Values values = parse_values(
      "[model]\ntimeout = 4\nconnections = 5\ndifference_step = 0.25\nname = \"n\"\nderivatives = \"none\"\n",
      "");
  const Sample s = sample_section().read(values);
  EXPECT_EQ(s.timeout, 4);
  EXPECT_EQ(s.connections, 5);
  EXPECT_EQ(s.difference_step, 0.25);
  EXPECT_EQ(s.name, "n");
  EXPECT_FALSE(s.derivatives);
  EXPECT_TRUE(values.complaints.empty());
}

TEST(OptionSection, AValueThatFailsACheckIsComplainedOfAndNotTaken) {
  Values values = parse_values("[model]\nconnections = 1\ndifference_step = 2\n", "");
  const Sample s = sample_section().read(values);
  EXPECT_EQ(s.connections, 3);
  EXPECT_FALSE(s.difference_step);
  ASSERT_EQ(values.complaints.size(), 2u);
  EXPECT_EQ(values.complaints[0].text, "\"model.connections\" must be at least 2");
  EXPECT_EQ(values.complaints[1].text, "\"model.difference_step\" is not below 1");
}

TEST(OptionSection, ListsAreOfTheirShape) {
  std::array<double, 2> pair{};
  EXPECT_TRUE(convert(std::vector<double>{1, 2}, pair));
  EXPECT_EQ(pair, (std::array<double, 2>{1, 2}));
  EXPECT_FALSE(convert(std::vector<double>{1, 2, 3}, pair));
  std::vector<std::size_t> steps;
  EXPECT_TRUE(convert(std::vector<double>{0, 7}, steps));
  EXPECT_EQ(steps, (std::vector<std::size_t>{0, 7}));
  EXPECT_FALSE(convert(std::vector<double>{0.5}, steps));
  EXPECT_FALSE(convert(std::vector<double>{-1}, steps));
  std::vector<int> components;
  EXPECT_TRUE(convert(std::vector<std::string>{"z", "x"}, components));
  EXPECT_EQ(components, (std::vector<int>{2, 0}));
  EXPECT_FALSE(convert(std::vector<std::string>{"w"}, components));
  int small = 0;
  EXPECT_FALSE(convert(std::int64_t{1} << 40, small));
}

}  // namespace
}  // namespace knothe::project
