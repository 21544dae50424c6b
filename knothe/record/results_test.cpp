// Reading of a results folder: what is there, what may be missing, what is refused and how.
#include "knothe/record/results.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/record/testing/result_examples.hpp"

namespace knothe::record {
namespace {

std::vector<std::string> lines_of(const std::string& path) {
  std::ifstream file(path);
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  return lines;
}

void write_lines(const std::string& path, const std::vector<std::string>& lines) {
  std::ofstream file(path);
  for (const auto& line : lines) file << line << "\n";
}

std::string message_of(const std::string& folder) {
  try {
    (void)read_results(folder);
  } catch (const DataError& e) {
    return e.what();
  }
  return {};
}

void replace(std::string& text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
}

TEST(Results, ReadsWhatAnAssimilationWrites) {
  const files::TestFolder place;
  const std::string folder = test::write_results(place, 5);
  const Results results = read_results(folder);
  ASSERT_EQ(results.steps.size(), 5u);  // not the last line, {"done":true,…}
  EXPECT_EQ(results.steps[2].step, 3u);
  EXPECT_EQ(results.parameters[1].name, "Ad");
  EXPECT_EQ(results.parameters[0].truth, 1.0);
  EXPECT_EQ(results.parameters[0].prior, "normal (mean = 0.9, std = 0.447)");
  EXPECT_DOUBLE_EQ(results.steps[0].standard_deviations()[0], 0.26);
  EXPECT_EQ(results.steps[0].quantiles.row(1).size(), 5);
  EXPECT_EQ(results.steps[4].marginals.at("Y0").points.size(), 101u);
  EXPECT_EQ(results.forecast_names(), std::vector<std::string>{"crack"});
  EXPECT_EQ(results.forecasts.at("crack").threshold, 0.04);
  EXPECT_EQ(results.displacement.size(), 101u);
  EXPECT_EQ(results.seed, "1");
  EXPECT_TRUE(results.untrusted().empty());
}

TEST(Results, OptionalPartsMayBeMissing) {
  const files::TestFolder place;
  const std::string folder = test::write_results(place, 2);
  std::filesystem::remove(folder + "/summary.json");
  auto lines = lines_of(folder + "/steps.jsonl");
  for (auto& line : lines)
    for (const char* key : {"\"marginals\"", "\"forecast\":{\"crack\""})
      if (const auto at = line.find(key); at != std::string::npos) line.replace(at + 1, 1, "_");
  write_lines(folder + "/steps.jsonl", lines);
  const Results results = read_results(folder);
  EXPECT_FALSE(results.summary_found);
  EXPECT_EQ(results.parameters[1].name, "parameter 1");
  EXPECT_TRUE(results.steps[0].marginals.empty());
  EXPECT_TRUE(results.forecast_names().empty());
}

TEST(Results, BrokenInputsAreNamedByFileAndLine) {
  EXPECT_EQ(message_of("/nonexistent/R"),
            "/nonexistent/R: error: no such results folder; `knothe assimilate PROJECT.toml -o RESULTS/` "
            "makes one");
  const files::TestFolder place;
  const std::string folder = test::write_results(place, 4), path = folder + "/steps.jsonl";
  const auto good = lines_of(path);
  const auto broken = [&](std::size_t line, const std::string& from, const std::string& to) {
    auto lines = good;
    replace(lines[line - 1], from, to);
    write_lines(path, lines);
    return message_of(folder);
  };
  EXPECT_EQ(broken(3, "{", "{{").find(path + ":3: error: not valid JSON"), 0u);
  EXPECT_EQ(broken(2, "\"ess\"", "\"es\""), path + ":2: error: key \"ess\" is missing");
  EXPECT_EQ(broken(2, "\"trusted\":true", "\"trusted\":1"),
            path + ":2: error: \"trusted\" must be true or false");
  EXPECT_EQ(broken(4, "\"maximum_a_posteriori\":0", "\"maximum_a_posteriori\":\"x\",\"y\":0"),
            path + ":4: error: \"forecast\": \"crack\": \"maximum_a_posteriori\" must be a finite number");
  EXPECT_EQ(broken(1, "\"mean\":[", "\"mean\":[0.1,"), path + ":1: error: \"covariance\" must have 3 rows");
  EXPECT_EQ(broken(1, "\"time\":0.01", "\"time\":1e999").find(path + ":1: error: not valid JSON"), 0u);
  EXPECT_EQ(broken(1, "\"used\":60", "\"used\":-1"), path + ":1: error: \"used\" must be an integer ≥ 0");
  write_lines(path, {});
  EXPECT_EQ(message_of(folder), path + ":1: error: no assimilated step in it");
  std::filesystem::remove(path);
  EXPECT_EQ(message_of(folder).find(path + ": error: cannot be read"), 0u);
  write_lines(path, good);
  write_lines(folder + "/summary.json", {"{\"parameters\":[{\"name\":\"a\"}]}"});
  EXPECT_EQ(message_of(folder), folder + "/summary.json: error: 1 parameters, but steps.jsonl has 2");
}

}  // namespace
}  // namespace knothe::record
