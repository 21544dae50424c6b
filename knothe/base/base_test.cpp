#include <gtest/gtest.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <numeric>
#include <thread>
#include <vector>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/console.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/base/threads.hpp"

namespace knothe {
namespace {

TEST(Error, SystemErrorSaysWhatWhereAndWhatToDo) {
  errno = ENOSPC;
  const IoError error = system_error("writing", "/tmp/a.h5");
  EXPECT_EQ(error.status(), ExitStatus::io);
  EXPECT_STREQ(
      error.what(),
      "writing: /tmp/a.h5: No space left on device (disk full: free some space, or write elsewhere with -o)");
}

TEST(Threads, EveryIndexOnceForAnyNumberOfThreads) {
  for (std::size_t threads : {1u, 2u, 7u}) {
    std::vector<std::atomic<int>> count(1000);
    parallel_for(count.size(), threads, [&](std::size_t i) { ++count[i]; });
    for (const auto& c : count) EXPECT_EQ(c.load(), 1);
  }
}

TEST(Threads, AnExceptionComesBack) {
  const auto run = [](std::size_t threads) {
    parallel_for(100, threads, [](std::size_t i) {
      if (i == 57) throw DataError("at 57");
    });
  };
  EXPECT_THROW(run(1), DataError);
  EXPECT_THROW(run(2), DataError);
}

TEST(Threads, OfSeveralErrorsThatOfTheSmallestIndexComesBack) {
  std::atomic<bool> other_failed = false;
  try {
    parallel_for(2, 2, [&](std::size_t i) {
      if (i == 1) {
        other_failed = true;
        other_failed.notify_all();
        throw DataError("at 1");
      }
      other_failed.wait(false);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));  // so that the other one is known before
      throw DataError("at 0");
    });
    ADD_FAILURE();
  } catch (const DataError& error) {
    EXPECT_STREQ(error.what(), "at 0");
  }
}

TEST(Text, EditDistanceCountsSwapsAsOne) {
  EXPECT_EQ(edit_distance("tolerance", "tolerance"), 0u);
  EXPECT_EQ(edit_distance("tolernace", "tolerance"), 1u);
  EXPECT_EQ(edit_distance("", "abc"), 3u);
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3u);
}

TEST(Text, NearMissSuggestsOnlyWhatIsNear) {
  const std::vector<std::string> keys = {"tolerance", "max_order", "seed"};
  EXPECT_EQ(did_you_mean("tolerence", keys), " (did you mean \"tolerance\"?)");
  EXPECT_EQ(did_you_mean("colour", keys), "");
}

/// 0 after the signal has asked to stop, 1 where it was ignored; a program that it kills has no status.
[[noreturn]] void raise_with_handlers(int number, void (*before)(int)) {
  std::signal(number, before);
  install_signal_handlers();
  std::raise(number);
  std::_Exit(cancellation_requested() ? 0 : 1);
}

TEST(Cancellation, SignalsAskToStop) {
  for (const int number : {SIGINT, SIGTERM, SIGHUP})
    EXPECT_EXIT(raise_with_handlers(number, SIG_DFL), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(raise_with_handlers(SIGHUP, SIG_IGN), testing::ExitedWithCode(1), "");  // of nohup
}

TEST(Cancellation, CheckThrowsOnceAsked) {
  EXPECT_NO_THROW(check_cancellation("nothing to keep"));
  request_cancellation();
  try {
    check_cancellation("3 of 9 runs are kept");
    FAIL();
  } catch (const Interrupted& error) {
    EXPECT_STREQ(error.what(), "interrupted; 3 of 9 runs are kept");
    EXPECT_EQ(error.status(), ExitStatus::interrupted);
  }
  request_cancellation(false);
}

TEST(Console, LinesAreBrokenAtBlanksAndContinuedWithAnIndent) {
  EXPECT_EQ(wrapped("  one two three\nfour", 9, 2), "  one two\n    three\nfour");
  EXPECT_EQ(wrapped("a    text to read", 14, 5), "a    text to\n     read");  // a column stays one
  EXPECT_EQ(wrapped("µµµµ µµµµ", 9), "µµµµ µµµµ");                            // characters, not bytes
  EXPECT_EQ(wrapped("unbreakable", 4), "unbreakable");
  EXPECT_EQ(wrapped("a\n\nb", 4), "a\n\nb");
}

TEST(Console, WhatIsNoTerminalGetsTheTextAsItIs) {
  std::FILE* const file = std::tmpfile();
  EXPECT_EQ(coloured("reject", Colour::red, file), "reject");
  const std::string line(300, 'x');
  EXPECT_EQ(for_people(line + " " + line, file), line + " " + line);
  EXPECT_EQ(cut_to_terminal(line, file).size(), 79U);
  std::fclose(file);
}

}  // namespace
}  // namespace knothe
