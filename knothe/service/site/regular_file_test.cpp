#include "knothe/service/site/regular_file.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::service {
namespace {

std::string refusal(const std::string& path, std::uintmax_t max_bytes = 1 << 20) {
  try {
    const RegularFile file(path, max_bytes);
    return "";
  } catch (const DataError& error) {
    return error.what();
  }
}

TEST(RegularFile, WhatIsNoFileIsRefusedAtOnce) {
  const files::TestFolder folder;
  ASSERT_EQ(::mkfifo(folder.file("pipe").c_str(), 0600), 0);
  std::filesystem::create_symlink("/etc/passwd", folder.file("link"));
  std::filesystem::create_symlink("pipe", folder.file("link-to-pipe"));
  std::filesystem::create_directory(folder.file("folder"));
  for (const char* name : {"pipe", "link", "link-to-pipe", "folder"})
    EXPECT_EQ(refusal(folder.file(name)),
              folder.file(name) +
                  ": is a symbolic link, a pipe, a device or a folder: only regular files are read");
  EXPECT_NE(refusal("/dev/zero"), "");
  EXPECT_NE(refusal(folder.file("none")).find("could not open the file"), std::string::npos);
  std::ofstream(folder.file("large")) << std::string(3 << 20, 'x');
  EXPECT_EQ(refusal(folder.file("large")), folder.file("large") + ": the file has 3 MB; at most 1 are read");
}

TEST(RegularFile, IsItsContentWhateverTakesItsName) {
  const files::TestFolder folder;
  const std::string path = folder.file("a");
  std::ofstream(path) << "abc";
  const RegularFile file(path, 1 << 20);
  std::filesystem::remove(path);
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  EXPECT_EQ(file.content(), "abc");
  // FIPS 180-2, B.1
  EXPECT_EQ(file.digest(), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  std::string same;
  std::ifstream(file.own_path()) >> same;
  EXPECT_EQ(same, "abc");
}

}  // namespace
}  // namespace knothe::service
