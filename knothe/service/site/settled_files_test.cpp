#include "knothe/service/site/settled_files.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "knothe/files/testing/test_folder.hpp"

namespace knothe::service {
namespace {

using std::chrono::milliseconds;
using Names = std::vector<std::string>;

bool is_csv(const std::string& name) {
  return name.ends_with(".csv");
}

bool is_text(const std::string& name) {
  return name.ends_with(".txt");
}

/// A clock that only the test moves.
struct Look {
  explicit Look(const files::TestFolder& folder) : files(folder.file(""), 0.5, is_csv, is_text) {}
  Names after(milliseconds pause) { return files.new_files(now += pause); }
  SettledFiles files;
  SettledFiles::Clock::time_point now = SettledFiles::Clock::now();
};

TEST(SettledFiles, AFileIsSettledWhenItHasNotChangedForAWhile) {
  const files::TestFolder folder;
  Look look(folder);
  std::ofstream(folder.file("f10.csv")) << "1";
  std::ofstream(folder.file("f9.csv")) << "1";
  std::ofstream(folder.file("other.txt")) << "1";
  EXPECT_EQ(look.after(milliseconds(0)), Names());
  std::ofstream(folder.file("f10.csv"), std::ios::app) << "2";
  EXPECT_EQ(look.after(milliseconds(600)), Names{"f9.csv"});
  EXPECT_EQ(look.after(milliseconds(600)), (Names{"f9.csv", "f10.csv"}));
  look.files.done("f9.csv");
  EXPECT_EQ(look.after(milliseconds(600)), Names{"f10.csv"});
  look.files.done("f10.csv");
  EXPECT_EQ(look.after(milliseconds(60'000)), Names());
  std::ofstream(folder.file("f9.csv"), std::ios::app) << "2";
  EXPECT_EQ(look.after(milliseconds(60'000)), Names()) << "it has just changed";
  EXPECT_EQ(look.after(milliseconds(600)), Names{"f9.csv"});
}

/// Neither who may read a file nor where it lies on the disk makes another file of it; and what is no file
/// has come, too.
TEST(SettledFiles, APermissionIsNoChangeAndAPipeIsSomethingThatCame) {
  const files::TestFolder folder;
  Look look(folder);
  std::ofstream(folder.file("a.csv")) << "1";
  (void)look.after(milliseconds(0));
  EXPECT_EQ(look.after(milliseconds(600)), Names{"a.csv"});
  look.files.done("a.csv");
  std::filesystem::permissions(folder.file("a.csv"), std::filesystem::perms::owner_all);
  ASSERT_EQ(::mkfifo(folder.file("pipe.csv").c_str(), 0600), 0);
  std::filesystem::create_symlink("/etc/passwd", folder.file("link.csv"));
  std::filesystem::create_symlink("nowhere", folder.file("broken.csv"));
  std::filesystem::create_directory(folder.file("folder.csv"));
  (void)look.after(milliseconds(5'000));
  EXPECT_EQ(look.after(milliseconds(600)), (Names{"broken.csv", "folder.csv", "link.csv", "pipe.csv"}));
}

/// A folder whose own time of change stands still is not listed again, so that files of any number cost
/// nothing; but not before that time is beyond doubt, and not for ever.
TEST(SettledFiles, AFileThatComesWithinTheFoldersClockIsSeen) {
  const files::TestFolder folder;
  struct stat before {};
  const auto put_back = [&] {  // as a coarse clock would
    const timespec times[2] = {before.st_atim, before.st_mtim};
    ASSERT_EQ(::utimensat(AT_FDCWD, folder.file("").c_str(), times, 0), 0);
  };
  Look look(folder);
  ASSERT_EQ(::stat(folder.file("").c_str(), &before), 0);
  (void)look.after(milliseconds(0));
  std::ofstream(folder.file("a.csv")) << "1";
  put_back();
  (void)look.after(milliseconds(100));
  EXPECT_EQ(look.after(milliseconds(600)), Names{"a.csv"});
  look.files.done("a.csv");
  (void)look.after(milliseconds(10'000));
  std::ofstream(folder.file("b.csv")) << "1";
  put_back();
  (void)look.after(milliseconds(10'000));
  EXPECT_EQ(look.after(milliseconds(600)), Names{"b.csv"});
}

TEST(SettledFiles, AFolderThatIsNotThereIsEmptyAndSaysSo) {
  SettledFiles files("/nowhere/at/all", 0.5, is_csv, is_text);
  EXPECT_EQ(files.new_files(SettledFiles::Clock::now()), Names());
  EXPECT_EQ(files.trouble(), "No such file or directory");
  const files::TestFolder folder;
  std::ofstream(folder.file("file")) << "1";
  const FolderContent content = content_of(folder.file("file"), is_csv, is_text);
  EXPECT_EQ(content.names, Names());
  EXPECT_EQ(content.trouble, "Not a directory");
}

TEST(SettledFiles, TheFirstForeignNameIsKnownWhileItIsThere) {
  const files::TestFolder folder;
  Look look(folder);
  for (const char* name : {"b.txt", "a.txt", "0.other", "c.csv"}) std::ofstream(folder.file(name)) << "1";
  (void)look.after(milliseconds(0));
  EXPECT_EQ(look.files.foreign(), "a.txt");
  EXPECT_EQ(look.files.trouble(), "");
  std::filesystem::remove(folder.file("a.txt"));
  std::filesystem::remove(folder.file("b.txt"));
  (void)look.after(milliseconds(600));
  EXPECT_EQ(look.files.foreign(), "");
}

}  // namespace
}  // namespace knothe::service
