#include "knothe/service/net/tokens.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::service {
namespace {

const std::string k_ada = "ada-0123456789abcdef", k_wall = "wall-0123456789abcdef";

struct TokensTest : ::testing::Test {
  files::TestFolder folder;
  project::Project project;

  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder.file(name)) << text;
    std::filesystem::permissions(folder.file(name), std::filesystem::perms(0640));
    return folder.file(name);
  }
  static std::optional<std::string> holder(const Tokens& tokens, const std::string& token, bool acts) {
    HttpRequest request;
    request.headers["authorization"] = "Bearer " + token;
    return tokens.holder(request, acts);
  }
  std::string refusal(const std::string& text) {
    project.serve.tokens = write("tokens", text);
    try {
      const Tokens tokens(project);
      return "";
    } catch (const Error& error) {
      return error.what();
    }
  }
};

TEST_F(TokensTest, ATokenWithANameSaysWhoActs) {
  project.serve.tokens = write("tokens", "# people\nAda " + k_ada + "\n\nwall " + k_wall + " read\n");
  project.serve.ingest_token = write("ingest", "ingest-0123456789abcdef\n");
  const Tokens tokens(project);
  EXPECT_TRUE(tokens.needed(false));
  EXPECT_TRUE(tokens.needed(true));
  EXPECT_EQ(holder(tokens, k_ada, true), "Ada");
  EXPECT_EQ(holder(tokens, k_ada, false), "Ada");
  EXPECT_EQ(holder(tokens, k_wall, false), "wall");
  EXPECT_EQ(holder(tokens, k_wall, true), std::nullopt);
  EXPECT_EQ(holder(tokens, "ingest-0123456789abcdef", true), "");
  EXPECT_EQ(holder(tokens, "ingest-0123456789abcdef", false), std::nullopt);
  EXPECT_EQ(holder(tokens, k_ada + "0", true), std::nullopt);
  EXPECT_EQ(holder(tokens, "", true), std::nullopt);
  EXPECT_EQ(tokens.holder({}, true), std::nullopt);
}

TEST_F(TokensTest, WithoutFilesNoneIsNeeded) {
  EXPECT_FALSE(Tokens(project).needed(false));
  EXPECT_FALSE(Tokens(project).needed(true));
}

TEST_F(TokensTest, AFileThatIsNotAsItShouldBeIsRefusedInWords) {
  EXPECT_NE(refusal("").find("has no token: a line is NAME TOKEN"), std::string::npos);
  EXPECT_NE(refusal("Ada short\n").find("tokens:1 has fewer than 16 characters"), std::string::npos);
  EXPECT_NE(refusal("Ada " + k_ada + "\nAda " + k_wall).find("tokens:2: Ada has a token already"),
            std::string::npos);
  EXPECT_NE(refusal("Ada " + k_ada + "\nBob " + k_ada).find("tokens:2: another has this token"),
            std::string::npos);
  EXPECT_NE(refusal("Ada " + k_ada + " write").find("tokens:1: a line is NAME TOKEN, or NAME TOKEN read"),
            std::string::npos);
  project.serve.tokens = write("open", "Ada " + k_ada);
  std::filesystem::permissions(folder.file("open"), std::filesystem::perms(0644));
  try {
    const Tokens tokens(project);
    FAIL();
  } catch (const Error& error) {
    const std::string path = folder.file("open");
    EXPECT_NE(std::string(error.what()).find(path + " can be read by everybody here: chmod o= " + path),
              std::string::npos);
  }
}

}  // namespace
}  // namespace knothe::service
