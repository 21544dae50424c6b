#include "knothe/files/atomic_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <fstream>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::files {
namespace {

using ::testing::HasSubstr;

TEST(AtomicFile, WritesAndReadsBack) {
  const TestFolder folder;
  const std::string path = folder.file("new/deep/a.txt");
  write_text_atomically(path, "first");
  write_text_atomically(path, std::string("second\0line\n", 12));
  EXPECT_EQ(read_text(path), std::string("second\0line\n", 12));
}

TEST(AtomicFile, ExceptionLeavesTheOldFileAndNoTemporary) {
  const TestFolder folder;
  const std::string path = folder.file("a.txt");
  write_text_atomically(path, "old");
  const auto failing = [&] {
    write_atomically(path, [](const std::string& temporary) {
      std::ofstream(temporary) << "half";
      throw NumericalError("solver stopped");
    });
  };
  EXPECT_EQ(message_of<NumericalError>(failing), "solver stopped");
  EXPECT_EQ(read_text(path), "old");
  EXPECT_EQ(folder.number_of_files(), 1U);
}

TEST(AtomicFile, MissingFileAndImpossibleFolderAreNamed) {
  const TestFolder folder;
  EXPECT_THAT(message_of<IoError>([&] { (void)read_text(folder.file("none")); }),
              HasSubstr("could not read: " + folder.file("none") + ": No such file"));
  write_text_atomically(folder.file("plain"), "x");
  EXPECT_THAT(message_of<IoError>([&] { write_text_atomically(folder.file("plain/below"), "x"); }),
              HasSubstr("could not make the folder"));
}

TEST(AtomicFile, ATextTooLargeForTheDiskLeavesNothing) {
  const TestFolder folder;
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{4096, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const std::string message =
      message_of<IoError>([&] { write_text_atomically(folder.file("big"), std::string(100000, 'x')); });
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, old_handler);
  EXPECT_THAT(message, HasSubstr("could not write: " + folder.file("big") + ": File too large"));
  EXPECT_EQ(folder.number_of_files(), 0U);
}

}  // namespace
}  // namespace knothe::files
