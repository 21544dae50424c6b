#include "knothe/service/net/dead_letters.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "knothe/files/testing/test_folder.hpp"
#include "knothe/service/net/mqtt_client.hpp"

namespace knothe::service {
namespace {

std::vector<std::string> lines_of(const std::string& path) {
  std::vector<std::string> lines;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  return lines;
}

TEST(DeadLetters, AreKeptInTheirOrderUpToABound) {
  const files::TestFolder folder;
  const std::string path = folder.file("j-refused.jsonl");
  const DeadLetters letters(path, 100);
  for (int k = 0; k < 7; ++k) EXPECT_TRUE(letters.store({{"k", k}, {"payload", "\xff not UTF-8 \n"}}));
  std::vector<int> kept;
  for (const std::string& file : {path + ".1", path})
    for (const std::string& line : lines_of(file)) kept.push_back(Json::parse(line)["k"].get<int>());
  ASSERT_GE(kept.size(), 3U);
  for (std::size_t i = 0; i < kept.size(); ++i) EXPECT_EQ(kept[i], 7 - static_cast<int>(kept.size() - i));
  EXPECT_LE(std::filesystem::file_size(path), 100U);
  EXPECT_EQ(std::filesystem::status(path).permissions(),
            std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
}

TEST(DeadLetters, WhereNothingCanBeWrittenThatIsSaid) {
  const files::TestFolder folder;
  EXPECT_FALSE(DeadLetters("/nowhere/at/all/j").store({{"k", 1}}));
  std::filesystem::create_symlink("elsewhere", folder.file("link"));
  EXPECT_FALSE(DeadLetters(folder.file("link")).store({{"k", 1}}));
  ASSERT_EQ(::mkfifo(folder.file("pipe").c_str(), 0600), 0);
  EXPECT_FALSE(DeadLetters(folder.file("pipe")).store({{"k", 1}}));
  EXPECT_FALSE(DeadLetters("/dev/full").store({{"k", 1}}));
}

/// Two machines with journals of one name are two clients of their broker.
TEST(MqttClient, AServiceHasANameOfItsOwnThatStays) {
  const files::TestFolder one, other;
  const std::string id = durable_client_id(one.file("beam.journal"));
  EXPECT_EQ(durable_client_id(one.file("beam.journal")), id);
  EXPECT_NE(durable_client_id(other.file("beam.journal")), id);
  EXPECT_LE(id.size(), 23U);
  EXPECT_NE(passing_client_id(), passing_client_id());
  std::ofstream(one.file("beam.journal-client"), std::ios::trunc) << "";
  EXPECT_NE(durable_client_id(one.file("beam.journal")), id) << "what is damaged is made anew";
}

}  // namespace
}  // namespace knothe::service
