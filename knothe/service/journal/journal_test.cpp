#include "knothe/service/journal/journal.hpp"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/service/journal/sqlite.hpp"
#include "knothe/service/testing/failing_files.hpp"
#include "knothe/service/testing/power_loss_files.hpp"

namespace knothe::service {
namespace {

constexpr Quarantine k_late = {true, false}, k_implausible = {false, true};

Measurement datum(std::int64_t seq, double value = 1, const std::string& source = "camera") {
  Measurement d;
  d.key = {source, "session", seq};
  d.time = 0.1 * static_cast<double>(seq);
  d.values = {value, -0.0, std::numeric_limits<double>::quiet_NaN(), 1e-300};
  d.status = {0, 0, 0, 2};
  d.step = seq;
  return d;
}

void append(Journal& journal, const Measurement& d) {
  journal.begin();
  journal.append(d);
  journal.commit();
}

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_bytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

int variants(int by_default) {
  const char* wanted = std::getenv("KNOTHE_VARIANTS");
  return wanted == nullptr ? by_default : std::atoi(wanted);
}

/// Seals after 0, 1, … records of a journal that is then closed.
std::vector<std::string> write_journal(const std::string& path, int records) {
  Journal journal(path);
  std::vector<std::string> seals = {journal.seal()};
  for (int i = 0; i < records; ++i) {
    append(journal, datum(i, 0.5 * i));
    seals.push_back(journal.seal());
  }
  return seals;
}

TEST(Journal, WhatIsAppendedIsThereToTheBitAfterReopening) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  std::string seal;
  {
    Journal journal(path);
    for (int i = 0; i < 5; ++i) append(journal, datum(i, 0.1 * i));
    seal = journal.seal();
  }
  const JournalReader journal(path);
  EXPECT_EQ(journal.seal(), seal);
  std::int64_t n = 0;
  journal.for_each([&](const JournalEntry& entry) {
    EXPECT_EQ(entry.id, n + 1);
    EXPECT_EQ(entry.measurement.payload(), datum(n, 0.1 * static_cast<double>(n)).payload());
    EXPECT_EQ(entry.measurement.key, datum(n).key);
    EXPECT_GT(entry.measurement.received_ms, 0);
    ++n;
  });
  EXPECT_EQ(n, 5);
}

TEST(Journal, ADuplicateIsKnownAndAConflictLeavesWhatIsThere) {
  const files::TestFolder folder;
  Journal journal(folder.file("j.journal"));
  journal.begin();
  EXPECT_EQ(journal.append(datum(3)).outcome, AppendOutcome::accepted);
  EXPECT_EQ(journal.append(datum(3)).outcome, AppendOutcome::duplicate);  // inside one group
  journal.commit();
  Measurement other_status = datum(3), other_time = datum(3);
  other_status.status[0] = 1;
  other_time.time += 1e-15;
  journal.begin();
  EXPECT_EQ(journal.append(datum(3)).outcome, AppendOutcome::duplicate);
  EXPECT_EQ(journal.append(datum(3, 2)).outcome, AppendOutcome::conflict);
  EXPECT_EQ(journal.append(other_status).outcome, AppendOutcome::conflict);
  EXPECT_EQ(journal.append(other_time).outcome, AppendOutcome::conflict);
  EXPECT_EQ(journal.append(datum(3, 2, "gauges")).outcome, AppendOutcome::accepted);
  journal.commit();
  EXPECT_EQ(journal.count(), 2);
}

TEST(Journal, AGroupThatIsRolledBackLeavesNothing) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  {
    Journal journal(path);
    append(journal, datum(0));
    const std::string seal = journal.seal();
    journal.begin();
    journal.append(datum(1));
    journal.rollback();
    EXPECT_EQ(journal.seal(), seal);
    append(journal, datum(2));
  }
  EXPECT_EQ(JournalReader(path).count(), 2);
}

TEST(Journal, QuarantinedDataAreReleasedOnce) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  {
    Journal journal(path);
    journal.begin();
    EXPECT_TRUE(journal.append(datum(7), k_late).quarantined);
    EXPECT_TRUE(journal.append(datum(7)).quarantined);
    EXPECT_FALSE(journal.release({datum(8).key}));
    journal.commit();
    EXPECT_EQ(journal.quarantined().size(), 1u);
    journal.begin();
    ASSERT_TRUE(journal.release({datum(7).key}));
    EXPECT_TRUE(journal.release({datum(7).key})->released);
    EXPECT_FALSE(journal.append(datum(7)).quarantined);
    journal.commit();
  }
  const JournalReader journal(path);
  EXPECT_TRUE(journal.quarantined().empty());
  journal.for_each([](const JournalEntry& entry) { EXPECT_TRUE(entry.quarantined && entry.released); });
}

/// A command that comes twice, or late, does nothing to the record that has taken the place of its own.
TEST(Journal, ACommandNamesItsRecord) {
  using Which = RecordName::Which;
  const files::TestFolder folder;
  Journal journal(folder.file("j.journal"));
  const likelihood::DatumKey key = datum(1).key;
  journal.begin();
  EXPECT_EQ(journal.append(datum(0)).record, 1);
  EXPECT_EQ(journal.append(datum(1, 1)).record, 2);
  EXPECT_EQ(journal.append(datum(1, 1)).record, 2) << "of the one that is there";
  EXPECT_FALSE(journal.withdraw({key, Which::numbered, 1})) << "of another key";
  EXPECT_FALSE(journal.withdraw({key, Which::first})->withdrawn);
  EXPECT_EQ(journal.withdrawn(key), true);
  EXPECT_EQ(journal.append(datum(1, 5)).record, 3);
  for (const RecordName& again : {RecordName{key, Which::first}, RecordName{key, Which::numbered, 2}}) {
    EXPECT_TRUE(journal.withdraw(again)->withdrawn) << "it was before";
    EXPECT_EQ(journal.withdrawn(key), false);
    EXPECT_FALSE(journal.release(again));
  }
  EXPECT_FALSE(journal.withdraw({key, Which::numbered, 3})->withdrawn);
  EXPECT_EQ(journal.withdrawn(key), true);
  journal.commit();
}

std::optional<JournalEntry> withdraw(Journal& journal, const likelihood::DatumKey& key) {
  journal.begin();
  auto entry = journal.withdraw({key});
  journal.commit();
  return entry;
}

/// Values of the data that count, in the order of their records.
std::vector<double> counting_values(const std::string& path) {
  std::vector<double> values;
  JournalReader(path).for_each([&](const JournalEntry& entry) {
    if (entry.counts()) values.push_back(entry.measurement.values[0]);
  });
  return values;
}

std::string refusal(const std::string& path) {
  try {
    const JournalReader journal(path);
  } catch (const DataError& error) {
    return error.what();
  }
  return "";
}

TEST(Journal, AWithdrawnDatumStaysOutAndMayComeAgain) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  {
    Journal journal(path);
    for (int i = 0; i < 3; ++i) append(journal, datum(i, 10 + i));
    EXPECT_FALSE(withdraw(journal, datum(7).key));
    EXPECT_FALSE(withdraw(journal, datum(1).key)->withdrawn);
    EXPECT_TRUE(withdraw(journal, datum(1).key)->withdrawn);  // it was before
    EXPECT_EQ(journal.withdrawals(), 1);
    EXPECT_EQ(journal.largest_seqs("camera", "session", 2), (std::vector<std::int64_t>{2, 0}));
    withdraw(journal, datum(2).key);
    EXPECT_EQ(journal.largest_seqs("camera", "session", 2), std::vector<std::int64_t>{0});
    EXPECT_TRUE(journal.largest_seqs("gauges", "session", 2).empty());
  }
  EXPECT_EQ(counting_values(path), std::vector<double>({10}));
  {
    Journal journal(path);
    journal.begin();
    const Appended again = journal.append(datum(1, 21));
    EXPECT_EQ(again.outcome, AppendOutcome::accepted);
    EXPECT_TRUE(again.replacement);
    EXPECT_EQ(journal.append(datum(1, 21)).outcome, AppendOutcome::duplicate);
    EXPECT_EQ(journal.append(datum(1, 11)).outcome, AppendOutcome::conflict);
    EXPECT_TRUE(journal.append(datum(2, 12)).replacement);  // the same values: it is back
    journal.commit();
    withdraw(journal, datum(2).key);
  }
  EXPECT_EQ(counting_values(path), std::vector<double>({10, 21}));
  EXPECT_EQ(JournalReader(path).count(), 5);
}

TEST(Journal, AReplacementIsLateOnlyIfWhatItReplacesWas) {
  const files::TestFolder folder;
  Journal journal(folder.file("j.journal"));
  append(journal, datum(0));
  journal.begin();
  journal.append(datum(1), k_late);
  journal.append(datum(2), k_late);
  journal.release({datum(2).key});
  journal.commit();
  for (int i = 0; i < 3; ++i) withdraw(journal, datum(i).key);
  EXPECT_TRUE(journal.quarantined().empty());
  journal.begin();
  EXPECT_FALSE(journal.release({datum(1).key}));
  EXPECT_FALSE(journal.append(datum(0, 2), k_late).quarantined);
  EXPECT_TRUE(journal.append(datum(1, 2), k_late).quarantined);
  EXPECT_FALSE(journal.append(datum(2, 2), k_late).quarantined);
  journal.commit();
  ASSERT_EQ(journal.quarantined().size(), 1u);
  EXPECT_EQ(journal.quarantined()[0].measurement.values[0], 2);
}

TEST(Journal, AnImplausibleReplacementIsHeldWhateverItReplaces) {
  const files::TestFolder folder;
  Journal journal(folder.file("j.journal"));
  append(journal, datum(0));
  journal.begin();
  journal.append(datum(1), k_implausible);
  journal.append(datum(2), {true, true});
  journal.commit();
  for (int i = 0; i < 3; ++i) withdraw(journal, datum(i).key);
  journal.begin();
  EXPECT_TRUE(journal.append(datum(0, 2), k_implausible).quarantined);
  EXPECT_FALSE(journal.append(datum(1, 2), k_late).quarantined);  // what it corrects came in time
  EXPECT_TRUE(journal.append(datum(2, 2), k_late).quarantined);
  journal.commit();
}

TEST(Journal, TheReasonOfAQuarantineIsKept) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal"), copy = folder.file("copy.journal");
  {
    Journal journal(path);
    journal.begin();
    for (std::int64_t code = 0; code < 4; ++code) journal.append(datum(code), Quarantine::of_code(code));
    EXPECT_EQ(journal.append(datum(2)).quarantined.code(), 2);
    journal.commit();
  }
  EXPECT_EQ(recover_journal(path, copy).saved, 4);
  for (const std::string& file : {path, copy}) {
    const JournalReader journal(file);
    EXPECT_EQ(journal.quarantined().size(), 3u);
    journal.for_each([](const JournalEntry& entry) {
      EXPECT_EQ(entry.quarantined.code(), entry.measurement.key.seq);
      EXPECT_EQ(entry.counts(), entry.measurement.key.seq == 0);
    });
  }
}

TEST(Journal, AWithdrawalThatIsRolledBackLeavesNothing) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  {
    Journal journal(path);
    append(journal, datum(0));
    journal.begin();
    journal.withdraw({datum(0).key});
    journal.rollback();
    EXPECT_EQ(journal.withdrawals(), 0);
    append(journal, datum(1));
    EXPECT_FALSE(withdraw(journal, datum(1).key)->withdrawn);
  }
  EXPECT_EQ(counting_values(path).size(), 1u);
}

TEST(Journal, ADamagedOrLostWithdrawalIsFoundAndRecoverySavesTheOthers) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  {
    Journal journal(path);
    for (int i = 0; i < 3; ++i) append(journal, datum(i, i));
    withdraw(journal, datum(0).key);
    withdraw(journal, datum(1).key);
    append(journal, datum(1, 5));
  }
  const auto damaged = [&](const char* sql) {
    const std::string copy = folder.file("damaged");
    std::filesystem::copy_file(path, copy, std::filesystem::copy_options::overwrite_existing);
    Database(copy, Database::Mode::read_write).execute(sql);
    return refusal(copy);
  };
  EXPECT_NE(damaged("UPDATE withdrawal SET measurement = 3 WHERE id = 1").find("withdrawal 1 of the journal"),
            std::string::npos);
  EXPECT_NE(damaged("DELETE FROM withdrawal WHERE id = 2").find("record 4 of the journal has the key"),
            std::string::npos);
  EXPECT_NE(damaged("INSERT INTO release SELECT * FROM withdrawal").find("release 1 of the journal"),
            std::string::npos);
  EXPECT_EQ(recover_journal(path, folder.file("new")).saved, 4);
  EXPECT_EQ(counting_values(folder.file("new")), counting_values(path));
  damaged("DELETE FROM withdrawal WHERE id = 2");
  const Recovery recovery = recover_journal(folder.file("damaged"), folder.file("newer"));
  EXPECT_EQ(recovery.saved, 3);
  EXPECT_NE(recovery.lost.at(0).find("whose withdrawal is lost"), std::string::npos);
}

TEST(Journal, OneOfSchema2IsReadAsItIsAndMigratedWhenItIsWritten) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  const std::string seal = write_journal(path, 4).back();
  Database(path, Database::Mode::read_write)
      .execute(
          "DROP TABLE withdrawal; DROP INDEX measurement_key; DROP TABLE alarm; DROP TABLE file; DROP TABLE "
          "logbook;"
          "DELETE FROM meta WHERE key = 'journal'; PRAGMA user_version = 2;"
          "CREATE UNIQUE INDEX key ON measurement(source, session, seq);");
  EXPECT_EQ(counting_values(path).size(), 4u);
  EXPECT_EQ(JournalReader(path).seal(), seal);
  Journal journal(path);
  EXPECT_EQ(journal.seal(), seal);
  withdraw(journal, datum(3).key);
  append(journal, datum(3, 8));
  EXPECT_EQ(counting_values(path), std::vector<double>({0, 0.5, 1, 8}));
}

TEST(Journal, AlarmsAreKeptAndDamageOfOneIsFound) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal"), copy = folder.file("copy.journal");
  {
    Journal journal(path);
    journal.begin();
    journal.append(datum(0));
    journal.add_alarm({7, 3, "alarm", "bias", "it does not fit", "bias", 123});
    journal.add_alarm({8, 4, "", "bias", "", "bias", 124});
    journal.add_alarm({9, 5, "info", "trust", "once", "", 125});
    journal.commit();
    journal.begin();
    journal.add_alarm({10, 6, "alarm", "bias", "again", "bias", 126});
    journal.rollback();
  }
  const JournalReader journal(path);
  ASSERT_EQ(journal.alarms(256).size(), 2U);
  EXPECT_EQ(journal.alarms(256)[0].message, "it does not fit");
  EXPECT_EQ(journal.alarms(1).at(0).id, 9);
  ASSERT_EQ(journal.conditions().size(), 1U);
  EXPECT_EQ(journal.conditions()[0].severity, "");
  EXPECT_EQ(journal.id().size(), 16U);
  EXPECT_EQ(journal.lost(), "");
  std::filesystem::copy_file(path, copy);
  {
    Database database(copy, Database::Mode::read_write);
    database.execute("UPDATE alarm SET step = 5 WHERE id = 2");
  }
  EXPECT_NE(refusal(copy).find("alarm 2 of the journal is damaged"), std::string::npos);
  const std::string saved = folder.file("saved.journal");
  EXPECT_EQ(recover_journal(copy, saved).lost, std::vector<std::string>{"alarms from 2 on"});
  EXPECT_EQ(JournalReader(saved).alarms(256).size(), 1U);
}

TEST(Journal, TheLogbookIsKeptAndDamageOfAnEntryIsFound) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal"), copy = folder.file("copy.journal");
  {
    Journal journal(path);
    journal.begin();
    journal.append(datum(0));
    EXPECT_EQ(journal.add_entry({0, EntryKind::sensor_off, 3, 0.5, "Ada", "loose", 0}).number, 1);
    EXPECT_EQ(journal.add_entry({0, EntryKind::note, 0, 0.7, "Bo", "a crack is heard", 0}).number, 2);
    journal.commit();
    journal.begin();
    journal.add_entry({0, EntryKind::note, 0, 0.8, "Bo", "never", 0});
    journal.rollback();
  }
  const std::vector<LogbookEntry> entries = JournalReader(path).logbook();
  ASSERT_EQ(entries.size(), 2U);
  EXPECT_EQ(entries[0].kind, EntryKind::sensor_off);
  EXPECT_EQ(entries[0].subject, 3);
  EXPECT_EQ(entries[0].time, 0.5);
  EXPECT_EQ(entries[1].author + ": " + entries[1].text, "Bo: a crack is heard");
  EXPECT_GT(entries[1].written_ms, 1'700'000'000'000);
  const auto changed = [&](const char* sql) {
    std::filesystem::copy_file(path, copy, std::filesystem::copy_options::overwrite_existing);
    Database(copy, Database::Mode::read_write).execute(sql);
    return refusal(copy);
  };
  EXPECT_NE(changed("UPDATE logbook SET kind = 'sung' WHERE id = 2").find("entry 2 of the journal's logbook"),
            std::string::npos);
  EXPECT_NE(changed("DELETE FROM logbook WHERE id = 1").find("entry 1 of the journal's logbook is damaged"),
            std::string::npos);
  EXPECT_NE(changed("UPDATE logbook SET time = 0.6 WHERE id = 2").find("entry 2 of the journal's logbook"),
            std::string::npos);
  const std::string saved = folder.file("saved.journal");
  EXPECT_EQ(recover_journal(copy, saved).lost, std::vector<std::string>{"logbook entries from 2 on"});
  EXPECT_EQ(JournalReader(saved).logbook().at(0).written_ms, entries[0].written_ms);
}

TEST(SensorSwitches, WhatWasWrittenLastHoldsFromItsTimeOn) {
  const std::vector<double> times = {0.1, 0.2, 0.3, 0.4};
  SensorSwitches switches(times);
  const auto add = [&](EntryKind kind, double time) {
    switches.add({0, kind, 1, time, "Ada", "", 0});
    return switches.first_step(time);
  };
  const auto off = [&] {
    std::string steps;
    for (std::size_t step = 0; step < times.size(); ++step) steps += switches.is_off(1, step) ? 'x' : '.';
    return steps;
  };
  EXPECT_EQ(off(), "....");
  EXPECT_EQ(add(EntryKind::sensor_off, 0.2), 1U);
  EXPECT_EQ(off(), ".xxx");
  add(EntryKind::note, 0.1);
  add(EntryKind::sensor_on, 0.4);
  EXPECT_EQ(off(), ".xx.");
  EXPECT_EQ(switches.off_at(2), std::vector<std::int64_t>{1});
  EXPECT_TRUE(switches.off_at(3).empty());
  Measurement datum;
  datum.values = {5, 6}, datum.status = {0, 0}, datum.step = 2;
  EXPECT_TRUE(std::isnan(switches.seen(datum).effective_values()[1]));
  EXPECT_EQ(switches.seen(datum).effective_values()[0], 5);
  datum.step = 0;
  EXPECT_EQ(switches.seen(datum).effective_values()[1], 6);
  EXPECT_EQ(add(EntryKind::sensor_on, 0.15), 1U);  // of a model with other times
  EXPECT_EQ(off(), "....");
  EXPECT_EQ(add(EntryKind::sensor_off, 9), 4U);
  EXPECT_EQ(off(), "....");
}

TEST(Journal, WhatWasAcknowledgedAndIsGoneIsSaid) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal"), old = folder.file("old.journal");
  {
    Journal journal(path);
    append(journal, datum(0));
    EXPECT_TRUE(journal.checkpoint());
    std::filesystem::copy_file(path, old);
    append(journal, datum(1));
    append(journal, datum(2));
  }
  EXPECT_EQ(JournalReader(path).lost(), "");
  std::filesystem::copy_file(old, path, std::filesystem::copy_options::overwrite_existing);
  EXPECT_TRUE(JournalReader(path).lost().starts_with("acknowledged and gone: records 2 to 3;"));
  {
    Journal journal(path);
    EXPECT_TRUE(journal.lost().starts_with("acknowledged and gone: records 2 to 3;"));
    for (int k = 3; k < 6; ++k) append(journal, datum(k));
  }
  EXPECT_EQ(Journal(path).lost(), "");
}

TEST(Journal, AJournalHasOneWriterAndManyReaders) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  Journal writer(path);
  append(writer, datum(0));
  const JournalReader reader(path);
  EXPECT_EQ(reader.count(), 1);
  std::filesystem::create_symlink(path, folder.file("link.journal"));
  for (const char* name : {"j.journal", "link.journal"}) {
    try {
      Journal second(folder.file(name));
      FAIL();
    } catch (const DataError& error) {
      EXPECT_NE(std::string(error.what()).find("another process writes this journal"), std::string::npos);
    }
  }
}

TEST(Journal, OtherSensorsAreRefusedOtherModelsRecorded) {
  const files::TestFolder folder;
  Journal journal(folder.file("j.journal"));
  EXPECT_FALSE(journal.identify({"sensors", "model", "configuration", "text"}));
  EXPECT_FALSE(journal.identify({"sensors", "model", "configuration", "text"}));
  EXPECT_TRUE(journal.identify({"sensors", "another model", "configuration", "text"}));
  EXPECT_THROW(journal.identify({"other sensors", "model", "configuration", "text"}), DataError);
  EXPECT_EQ(journal.identity()->model, "another model");
}

TEST(Journal, WhatIsNoJournalIsRefusedByName) {
  const files::TestFolder folder;
  const auto message = [](const auto& open) -> std::string {
    try {
      (void)open();
    } catch (const Error& error) {
      EXPECT_EQ(error.status(), ExitStatus::data);
      return error.what();
    }
    return "";
  };
  EXPECT_NE(message([&] { return JournalReader(folder.file("none")); }).find("there is no such journal"),
            std::string::npos);
  write_bytes(folder.file("text"),
              "This is a text that is no database, and long enough to be read as one.\n");
  EXPECT_NE(message([&] { return JournalReader(folder.file("text")); }).find("not a database"),
            std::string::npos);
  {
    Database other(folder.file("other"), Database::Mode::create);
    other.execute("CREATE TABLE t(x)");
  }
  EXPECT_NE(message([&] { return Journal(folder.file("other")); }).find("not a journal of knothe"),
            std::string::npos);
  write_journal(folder.file("newer"), 1);
  {
    Database newer(folder.file("newer"), Database::Mode::read_write);
    newer.execute("PRAGMA user_version = 99");
  }
  EXPECT_NE(message([&] { return JournalReader(folder.file("newer")); }).find("use a newer knothe"),
            std::string::npos);
}

TEST(Journal, AChangedRecordIsNamedAndTheOthersAreRecovered) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  write_journal(path, 10);
  {
    Database database(path, Database::Mode::read_write);
    database.execute(
        "UPDATE measurement SET time = time + 1 WHERE id = 4; DELETE FROM measurement WHERE id = 8;");
  }
  try {
    Journal journal(path);
    FAIL();
  } catch (const DataError& error) {
    EXPECT_NE(std::string(error.what()).find("record 4"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("knothe recover"), std::string::npos);
  }
  const Recovery recovery = recover_journal(path, folder.file("new"));
  EXPECT_EQ(recovery.saved, 8);
  ASSERT_EQ(recovery.lost.size(), 2u);
  EXPECT_NE(recovery.lost[0].find("record 4"), std::string::npos);
  EXPECT_NE(recovery.lost[1].find("record 8"), std::string::npos);
  EXPECT_EQ(JournalReader(folder.file("new")).count(), 8);
  EXPECT_THROW((void)recover_journal(path, folder.file("new")), UsageError);
}

TEST(Journal, ADamagedRecordNumberDoesNotHaveRecoverySearchForEver) {
  // Found by the fuzzer: a number of 2^62 was taken for a count.
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  write_journal(path, 5);
  Database(path, Database::Mode::read_write)
      .execute("UPDATE measurement SET id = 4611686018427387904 WHERE id = 5;");
  const Recovery recovery = recover_journal(path, folder.file("new"));
  EXPECT_EQ(recovery.saved, 4);
  EXPECT_NE(recovery.lost.at(0).find("its number is damaged"), std::string::npos);
}

TEST(Journal, ATornLogOpensAtTheLastCompleteRecord) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  std::vector<std::string> seals;
  std::string database, log;
  {
    Journal journal(path);
    seals.push_back(journal.seal());
    for (int i = 0; i < 12; ++i) {
      append(journal, datum(i));
      seals.push_back(journal.seal());
    }
    // As a power failure leaves them: the journal is still open.
    database = bytes_of(path);
    log = bytes_of(path + "-wal");
  }
  std::mt19937_64 random(1);
  std::size_t most = 0;
  for (int k = 0; k < variants(120); ++k) {
    const std::string torn = folder.file("torn");
    for (const char* tail : {"", "-wal", "-shm"}) std::filesystem::remove(torn + tail);
    write_bytes(torn, database);
    std::string part = log.substr(0, random() % (log.size() + 1));
    if (k % 2 == 1 && !part.empty()) part[random() % part.size()] ^= static_cast<char>(1 << random() % 8);
    write_bytes(torn + "-wal", part);
    try {
      const Journal journal(torn);
      const auto n = static_cast<std::size_t>(journal.count());
      ASSERT_LE(n, 12u);
      ASSERT_EQ(journal.seal(), seals[n]);
      most = std::max(most, n);
    } catch (const DataError&) {
      // Where the log was cut before the tables were there.
    }
  }
  EXPECT_GE(most, 10u);
}

TEST(Journal, AFlippedBitIsFoundOrHarmless) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  const std::string seal = write_journal(path, 30).back();
  const std::string whole = bytes_of(path);
  std::mt19937_64 random(2);
  int found = 0;
  for (int k = 0; k < variants(400); ++k) {
    const std::string flipped = folder.file("flipped");
    for (const char* tail : {"", "-wal", "-shm"}) std::filesystem::remove(flipped + tail);
    std::string bytes = whole;
    bytes[random() % bytes.size()] ^= static_cast<char>(1 << random() % 8);
    write_bytes(flipped, bytes);
    try {
      const JournalReader journal(flipped);
      ASSERT_EQ(journal.count(), 30);
      ASSERT_EQ(journal.seal(), seal);
    } catch (const DataError& error) {
      EXPECT_NE(std::string(error.what()).find(flipped), std::string::npos);
      ++found;
    } catch (const IoError& error) {
      EXPECT_NE(std::string(error.what()).find(flipped), std::string::npos);
      ++found;
    }
  }
  EXPECT_GT(found, 0);
}

TEST(Journal, WhicheverWriteFailsWhatWasCommittedStaysAndNothingElse) {
  const files::TestFolder folder;
  FailingFiles files;
  bool failed = true;
  int tried = 0;
  for (int n = 1; failed; ++n) {
    const std::string path = folder.file("j" + std::to_string(n));
    std::vector<Measurement> committed;
    files.fail_from(n);
    try {
      Journal journal(path);
      for (int i = 0; i < 6; ++i) {
        try {
          journal.begin();
          journal.append(datum(2 * i));
          journal.append(datum(2 * i + 1));
          journal.commit();
          committed.push_back(datum(2 * i));
          committed.push_back(datum(2 * i + 1));
        } catch (const DiskFullError&) {
          journal.rollback();
          if (i == 3) files.fail_from(0);  // there is room again
        }
      }
    } catch (const Error&) {
      EXPECT_TRUE(committed.empty());
    }
    failed = files.failed();
    files.fail_from(0);
    ++tried;
    if (!std::filesystem::exists(path) || committed.empty()) continue;
    const Journal journal(path);
    std::vector<std::string> found;
    journal.for_each([&](const JournalEntry& entry) { found.push_back(entry.measurement.payload()); });
    ASSERT_EQ(found.size(), committed.size()) << "with the write " << n << " failing";
  }
  EXPECT_GT(tried, 20);
}

/// Every kind of call: opening, reading, writing, sizes, shared memory. Whoever is told of it by an exception
/// has nothing of that group stored, or finds it stored; never anything else.
TEST(Journal, WhicheverCallFailsOnceNothingThatWasCommittedIsLost) {
  const files::TestFolder folder;
  FailingFiles files;
  bool failed = true;
  int tried = 0;
  for (int n = 1; failed; ++n) {
    const std::string path = folder.file("j" + std::to_string(n));
    std::vector<std::int64_t> committed;
    files.fail_once(n);
    for (int again = 0; again < 2 && committed.size() < 4; ++again) try {
        Journal journal(path);
        for (int i = 0; i < 4; ++i) {
          try {
            journal.begin();
            journal.append(datum(4 * again + i));
            journal.commit();
            committed.push_back(4 * again + i);
          } catch (const Error&) {
            journal.rollback();
          }
        }
        (void)journal.checkpoint();
      } catch (const Error&) {  // it cannot be opened, or merged: at the next start
      }
    failed = files.failed();
    files.fail_from(0);
    ++tried;
    ASSERT_GE(committed.size(), 3U) << "with call " << n << " failing";
    const Journal journal(path);
    EXPECT_EQ(journal.lost(), "");
    std::vector<std::int64_t> found;
    journal.for_each([&](const JournalEntry& entry) { found.push_back(entry.measurement.key.seq); });
    EXPECT_TRUE(std::includes(found.begin(), found.end(), committed.begin(), committed.end()))
        << "with call " << n << " failing";
  }
  EXPECT_GT(tried, 60);
}

/// As SQLite's own tests do: of what was written and not synced, any sectors are on disk, some of them torn.
TEST(Journal, WhateverPowerFailureLeavesWhatWasAcknowledgedIsThere) {
  const files::TestFolder folder;
  const int count = variants(60);
  std::int64_t records = 0;
  for (int seed = 0; seed < count; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(static_cast<unsigned>(seed));
    const std::string path = folder.file("p" + std::to_string(seed));
    std::int64_t acknowledged = 0;
    for (int failure = 0; failure < 3; ++failure) {
      PowerLossFiles files;
      files.lose_power_at(1 + static_cast<int>(random() % 80));
      try {
        Journal journal(path);
        files.sync_names();  // as a journal does at its start
        EXPECT_EQ(journal.lost(), "");
        ASSERT_GE(journal.count(), acknowledged);
        acknowledged = journal.count();  // what came through though nobody was told
        for (int i = 0; i < 12; ++i) {
          const int size = 1 + static_cast<int>(random() % 3);
          journal.begin();
          for (int k = 0; k < size; ++k) journal.append(datum(acknowledged + k));
          if (acknowledged > 0 && random() % 4 == 0)
            journal.withdraw({datum(static_cast<std::int64_t>(random()) % acknowledged).key});
          journal.commit();
          acknowledged += size;
          if (random() % 4 == 0) (void)journal.checkpoint();
        }
      } catch (const Error&) {
        EXPECT_TRUE(files.is_off());
      }
      files.restore_power(static_cast<unsigned>(random()));
      std::filesystem::remove(path + "-shm");
    }
    const Journal journal(path);
    EXPECT_EQ(journal.lost(), "");
    std::int64_t n = 0;
    journal.for_each([&](const JournalEntry& entry) {
      EXPECT_EQ(entry.measurement.payload(), datum(n).payload());
      ++n;
    });
    EXPECT_GE(n, acknowledged);
    records += n;
  }
  EXPECT_GT(records, 5 * count);
}

}  // namespace
}  // namespace knothe::service
