#include "knothe/service/site/file_register.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/service/journal/journal.hpp"
#include "knothe/service/journal/sqlite.hpp"

namespace knothe::service {
namespace {

JournalFile file(const std::string& name, const std::string& digest, FileOutcome outcome,
                 std::int64_t seq = -1) {
  return {"pictures", name, digest, outcome, seq};
}

TEST(FileRegister, AFileIsItsContent) {
  FileRegister files;
  EXPECT_EQ(files.settled(file("a", "1", FileOutcome::taken)), std::nullopt);
  files.note(file("a", "1", FileOutcome::taken, 7));
  files.note(file("old", "2", FileOutcome::elsewhere));
  files.note(file("bad", "3", FileOutcome::refused));
  EXPECT_EQ(files.settled(file("a", "1", FileOutcome::taken)), FileOutcome::taken);
  EXPECT_EQ(files.settled(file("a", "4", FileOutcome::taken)), std::nullopt) << "another file of that name";
  EXPECT_EQ(files.settled(file("b", "1", FileOutcome::taken)), std::nullopt)
      << "a picture that shows the same";
  EXPECT_EQ(files.settled(file("renamed", "2", FileOutcome::taken)), FileOutcome::elsewhere);
  EXPECT_EQ(files.settled(file("old", "5", FileOutcome::taken)), std::nullopt) << "of the new specimen";
  EXPECT_EQ(files.settled(file("bad", "3", FileOutcome::taken)), FileOutcome::refused);
  EXPECT_EQ(files.digest_of("pictures", "old"), "2");
  EXPECT_EQ(files.digest_of("csv", "old"), "");
  EXPECT_EQ(files.holder({"pictures", "live", 7}), std::nullopt) << "no datum yet";
  files.hold({"pictures", "live", 7});
  files.hold({"pictures", "live", 8});
  EXPECT_EQ(files.holder({"pictures", "live", 7}), "a");
  EXPECT_EQ(files.holder({"pictures", "live", 8}), "");
  files.note(file("bad", "3", FileOutcome::refused));
  EXPECT_EQ(files.take_unwritten().size(), 3U) << "the same is kept once";
  EXPECT_FALSE(files.has_unwritten());
}

TEST(FileRegister, IsInTheJournalItsBackupAndWhatIsRecovered) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  const std::vector<JournalFile> kept = {file("a", "1", FileOutcome::taken, 7),
                                         file("old", "2", FileOutcome::elsewhere),
                                         file("bad", "", FileOutcome::refused)};
  {
    Journal journal(path);
    journal.begin();
    for (const JournalFile& one : kept) journal.add_file(one);
    journal.commit();
    journal.begin();
    journal.add_file(kept[0]);
    journal.rollback();
  }
  const auto names = [](const std::vector<JournalFile>& files) {
    std::string all;
    for (const JournalFile& f : files)
      all += f.source + " " + f.name + " " + f.digest + " " + to_text(f.outcome) + " " +
             std::to_string(f.seq) + "\n";
    return all;
  };
  const std::string expected =
      "pictures a 1 taken 7\npictures old 2 elsewhere -1\npictures bad  refused -1\n";
  EXPECT_EQ(names(JournalReader(path).files()), expected);
  (void)backup_journal(path, folder.file("backup.journal"));
  EXPECT_EQ(names(JournalReader(folder.file("backup.journal")).files()), expected);
  EXPECT_TRUE(recover_journal(path, folder.file("recovered.journal")).lost.empty());
  EXPECT_EQ(names(JournalReader(folder.file("recovered.journal")).files()), expected);
  Database(path, Database::Mode::read_write).execute("UPDATE file SET digest = '9' WHERE id = 2");
  try {
    const JournalReader damaged(path);
    ADD_FAILURE();
  } catch (const DataError& error) {
    EXPECT_NE(std::string(error.what()).find("file 2 of the journal is damaged"), std::string::npos);
  }
}

}  // namespace
}  // namespace knothe::service
