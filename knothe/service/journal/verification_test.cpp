#include "knothe/service/journal/verification.hpp"

#include <gtest/gtest.h>

#include "knothe/files/testing/test_folder.hpp"
#include "knothe/service/journal/journal.hpp"

namespace knothe::service {
namespace {

TEST(Verification, IsAnEntryOfTheLogbook) {
  const files::TestFolder folder;
  Verification said;
  said.version = 3;
  said.base = std::string(64, 'b');
  said.model = std::string(64, 'a');
  said.runs = 7;
  said.moved_std = 0.1 + 0.2;
  said.thorough = true;
  said.trouble = "\"quoted\", ü and \xff";
  said.time = 1.0 / 3;
  {
    Journal journal(folder.file("j"));
    journal.begin();
    journal.add_entry({0, EntryKind::verification_asked, 0, 0.1, "Ada", "", 0});
    journal.add_entry(entry_of(said));
    journal.add_entry({0, EntryKind::verification, 4, 0.2, "knothe", "not what is written here", 0});
    journal.commit();
  }
  const auto entries = JournalReader(folder.file("j")).logbook();
  const Verification read = last_verification(entries, said.base);
  EXPECT_EQ(read.version, 3u);
  EXPECT_EQ(read.model, said.model);
  EXPECT_EQ(read.runs, 7u);
  EXPECT_EQ(read.moved_std, said.moved_std);
  EXPECT_TRUE(read.thorough);
  EXPECT_EQ(read.trouble, "\"quoted\", ü and \uFFFD");
  EXPECT_EQ(read.time, said.time);
  // That of another model says nothing of this one.
  EXPECT_EQ(last_verification(entries, "other").version, 0u);
  EXPECT_EQ(last_verification(entries, "other").base, "other");
}

TEST(Verification, IsWantedAfterARequestAndAfterTheEndOfATest) {
  std::vector<LogbookEntry> entries;
  const auto awaits_after = [&](EntryKind kind, bool thorough = false) {
    Verification said;
    said.thorough = thorough;
    LogbookEntry entry = entry_of(said);
    if (kind != EntryKind::verification) entry = {0, kind, 0, 0, "Ada", "", 0};
    entries.push_back(entry);
    return awaits_verification(entries);
  };
  EXPECT_FALSE(awaits_after(EntryKind::note));
  EXPECT_TRUE(awaits_after(EntryKind::verification_asked));
  EXPECT_TRUE(awaits_after(EntryKind::verification));  // of a doubt that was asked about before
  EXPECT_FALSE(awaits_after(EntryKind::verification, true));
  EXPECT_TRUE(awaits_after(EntryKind::test_finished));
  EXPECT_FALSE(awaits_after(EntryKind::test_resumed));
}

}  // namespace
}  // namespace knothe::service
