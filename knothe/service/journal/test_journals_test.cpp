#include "knothe/service/journal/test_journals.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/service/journal/journal.hpp"

namespace knothe::service {
namespace {

void write(const std::string& path, EntryKind kind, const std::string& text = "") {
  Journal journal(path);
  journal.begin();
  journal.add_entry({0, kind, 0, 0.5, "Ada", text, 0});
  journal.commit();
}

TEST(TestJournals, ANameHasLettersDigitsAndTwoSigns) {
  EXPECT_EQ(objection_to_test_name("Beam_12-b"), "");
  EXPECT_EQ(objection_to_test_name(std::string(64, 'x')), "");
  EXPECT_EQ(objection_to_test_name(""), "a test's name must not be empty");
  EXPECT_EQ(objection_to_test_name(std::string(65, 'x')), "a test's name has at most 64 characters, not 65");
  for (const char* bad : {"a/b", "..", "a.b", "a b", "é", "a\n"})
    EXPECT_EQ(objection_to_test_name(bad),
              fmt::format("\"{}\": a test's name has letters, digits, '-' and '_' only", bad));
}

TEST(TestJournals, AreListedBesideTheFirst) {
  const files::TestFolder folder;
  const std::string first = folder.file("beam.journal");
  EXPECT_TRUE(tests_beside(first).empty());
  for (const char* name :
       {"beam.b.journal", "beam.a.journal", "beam.journal", "beam.a.journal-wal", "other.journal",
        "beam.x y.journal", "beam.c.d.journal", "beamer.journal", "beam..journal"})
    std::ofstream(folder.file(name)) << "";
  EXPECT_EQ(tests_beside(first), (std::vector<std::string>{"", "a", "b"}));
  EXPECT_EQ(journal_of_test(first, "a"), folder.file("beam.a.journal"));
  EXPECT_EQ(journal_of_test(first, ""), first);
}

TEST(TestJournals, TheLastToFollowIsServed) {
  const files::TestFolder folder;
  const std::string first = folder.file("beam.journal");
  EXPECT_EQ(last_to_follow(first, ""), "");
  EXPECT_EQ(last_to_follow(first, "a"), "a");
  write(first, EntryKind::test_finished);
  EXPECT_EQ(last_to_follow(first, ""), "");
  write(first, EntryKind::test_followed, "a");
  EXPECT_THROW((void)last_to_follow(first, ""), DataError);  // its journal is gone
  write(folder.file("beam.a.journal"), EntryKind::test_followed, "b");
  write(folder.file("beam.b.journal"), EntryKind::test_begun);
  EXPECT_EQ(last_to_follow(first, ""), "b");
  EXPECT_EQ(last_to_follow(first, "a"), "b");
  EXPECT_EQ(last_to_follow(first, "b"), "b");
  // Gone back to, from the middle and from the end.
  write(folder.file("beam.a.journal"), EntryKind::test_resumed);
  EXPECT_EQ(last_to_follow(first, ""), "a");
  write(folder.file("beam.b.journal"), EntryKind::test_followed, "a");
  EXPECT_EQ(last_to_follow(first, "b"), "a");
  // What no service writes, a circle, ends too.
  write(folder.file("beam.a.journal"), EntryKind::test_followed, "b");
  EXPECT_EQ(last_to_follow(first, "b"), "b");
  std::ofstream(folder.file("beam.b.journal"), std::ios::trunc) << "no journal";
  EXPECT_EQ(last_to_follow(first, ""), "b");
}

/// Each journal of a chain is archived in its turn: nothing new and empty is served in its place.
TEST(TestJournals, AMissingJournalIsToldWhereverItStoodInTheChain) {
  const auto refusal = [](const std::string& first, const std::string& asked) -> std::string {
    try {
      return "serves " + last_to_follow(first, asked);
    } catch (const DataError& error) {
      return error.what();
    }
  };
  for (const std::string gone : {"", "a", "b"}) {
    const files::TestFolder folder;
    const std::string first = folder.file("beam.journal");
    write(first, EntryKind::test_followed, "a");
    for (const auto& [test, next] : {std::pair{"a", "b"}, {"b", ""}}) {
      write(journal_of_test(first, test), EntryKind::test_begun);
      if (*next != 0)
        write(journal_of_test(first, test), EntryKind::test_followed, next);
      else
        write(journal_of_test(first, test), EntryKind::note, "a note");
    }
    EXPECT_EQ(refusal(first, ""), "serves b");
    EXPECT_EQ(refusal(first, "c"), "serves c") << "a new test of a name that is free";
    const std::string path = journal_of_test(first, gone);
    std::filesystem::remove(path);
    const std::string said = refusal(first, "");
    EXPECT_TRUE(said.starts_with(path + ": is missing")) << said;
    EXPECT_NE(said.find("--test"), std::string::npos) << said;
    EXPECT_FALSE(std::filesystem::exists(path));
    if (gone == "b") continue;
    EXPECT_EQ(refusal(first, "b"), "serves b") << "as the message says";
    EXPECT_TRUE(refusal(first, gone).starts_with(path + ": is missing")) << "asked for by its name";
    write(journal_of_test(first, "b"), EntryKind::test_finished);
    if (gone == "") {
      EXPECT_EQ(refusal(first, ""), "serves ") << "nothing goes on: the folder is used again";
    }
  }
}

TEST(TestJournals, AGlanceTellsWhetherATestIsUsed) {
  const files::TestFolder folder;
  const std::string path = folder.file("beam.a.journal");
  std::ofstream(path) << "";  // of a program that died at once
  EXPECT_FALSE(glance_at_journal(path).is_used);
  write(path, EntryKind::test_begun);
  const JournalGlance begun = glance_at_journal(path);
  EXPECT_FALSE(begun.is_used);
  EXPECT_FALSE(begun.finished);
  EXPECT_GT(begun.begun_ms, 1'700'000'000'000);
  write(path, EntryKind::test_followed, "");
  const JournalGlance left = glance_at_journal(path);
  EXPECT_TRUE(left.is_used);
  EXPECT_TRUE(left.finished);
  EXPECT_EQ(left.followed_by, "");
  write(path, EntryKind::test_resumed);
  EXPECT_EQ(glance_at_journal(path).followed_by, std::nullopt);
  EXPECT_FALSE(glance_at_journal(path).finished);
}

TEST(TestJournals, ACourseEndsAndIsFollowed) {
  const auto entry = [](EntryKind kind, std::int64_t at) {
    return LogbookEntry{0, kind, 0, 0, "Ada", "b", at};
  };
  TestCourse first, begun;
  first.add(entry(EntryKind::test_followed, 100));
  first.add(entry(EntryKind::test_resumed, 200));
  EXPECT_FALSE(first.end());
  first.add(entry(EntryKind::test_finished, 300));
  begun.add(entry(EntryKind::test_begun, 100));
  begun.add(entry(EntryKind::test_followed, 200));
  EXPECT_EQ(first.end()->kind, EntryKind::test_finished);
  EXPECT_EQ(begun.followed_by(), "b");
}

TEST(TestJournals, StartsGoOnFromThoseOfAnotherJournal) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  {
    Journal journal(path);
    EXPECT_EQ(journal.starts(), 1);
    journal.raise_starts(7);
    EXPECT_EQ(journal.starts(), 7);
    journal.raise_starts(3);
    EXPECT_EQ(journal.starts(), 7);
  }
  EXPECT_EQ(Journal(path).starts(), 8);
}

}  // namespace
}  // namespace knothe::service
