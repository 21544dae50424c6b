#include <fmt/format.h>

#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/service/journal/journal.hpp"
#include "knothe/service/journal/journal_records.hpp"
#include "knothe/service/journal/journal_schema.hpp"
#include "knothe/service/journal/sqlite.hpp"
#include "knothe/service/journal/verification.hpp"

namespace knothe::service {
namespace {

/// Records are numbered from 1 without gaps and each has a seal, so a file (and its log) of so many bytes
/// cannot hold more: a damaged number must not have us look for billions.
std::int64_t max_records(const std::string& journal) {
  std::uintmax_t bytes = 0;
  for (const char* part : {"", "-wal"}) {
    std::error_code failure;
    const std::uintmax_t size = std::filesystem::file_size(journal + part, failure);
    if (!failure) bytes += size;
  }
  return bytes / sizeof(Digest);
}

/// With what became of it: its key may come again later.
void save(const JournalEntry& entry, Journal& whole, Recovery& recovery) {
  const Measurement& datum = entry.measurement;
  if (whole.append(datum, entry.quarantined).outcome != AppendOutcome::accepted) {
    recovery.lost.push_back(
        fmt::format("record {}: there is another of its key, whose withdrawal is lost", entry.id));
    return;
  }
  ++recovery.saved;
  if (entry.released) whole.release({datum.key});
  if (entry.withdrawn) whole.withdraw({datum.key});
}

/// Those before the first that is damaged.
void save_alarms(Database& damaged, Journal& whole, Recovery& recovery) {
  if (schema_of(damaged) < 4) return;
  std::string previous = "alarms";
  std::int64_t number = 0;
  bool all = true;
  try {
    Statement rows(
        damaged,
        "SELECT id, seal, event, step, severity, kind, message, condition, raised FROM alarm ORDER BY id");
    while (rows.step()) {
      const Alarm alarm = read_alarm(rows, 2);
      if (rows.integer(0) != number + 1 || rows.text(1) != alarm_seal(previous, number + 1, alarm)) {
        all = false;
        break;
      }
      whole.add_alarm(alarm);
      previous = rows.text(1);
      ++number;
    }
  } catch (const DataError&) {
    all = false;
  }
  if (!all) recovery.lost.push_back(fmt::format("alarms from {} on", number + 1));
}

/// The same of the logbook.
void save_logbook(Database& damaged, Journal& whole, Recovery& recovery) {
  std::string previous = "logbook";
  std::int64_t number = 0;
  bool all = true;
  try {
    all = visit_logbook(damaged, [&](const LogbookEntry& entry, const std::string& seal) {
      if (entry.number != number + 1 || seal != entry_seal(previous, entry)) return false;
      whole.add_entry(entry);
      previous = seal;
      ++number;
      return true;
    });
  } catch (const DataError&) {
    all = false;
  }
  if (!all) recovery.lost.push_back(fmt::format("logbook entries from {} on", number + 1));
}

/// The same of files.
void save_files(Database& damaged, Journal& whole, Recovery& recovery) {
  std::string previous = "files";
  std::int64_t last = 0;
  bool all = true;
  try {
    all = visit_files(damaged, [&](std::int64_t number, const JournalFile& file, const std::string& seal) {
      if (number != last + 1 || seal != file_seal(previous, number, file)) return false;
      whole.add_file(file);
      previous = seal;
      last = number;
      return true;
    });
  } catch (const DataError&) {
    all = false;
  }
  if (!all) recovery.lost.push_back(fmt::format("files of watched folders from {} on", last + 1));
}

}  // namespace

Recovery recover_journal(const std::string& from, const std::string& to) {
  if (!std::filesystem::exists(from)) throw DataError(fmt::format("{}: there is no such journal", from));
  if (std::filesystem::exists(to))
    throw UsageError(fmt::format("{}: is there already; recover into a new file", to));
  require_no_refinement(from, to);
  Recovery recovery;
  Database damaged(from, Database::Mode::read_only);
  Journal whole(to);
  whole.begin();
  std::string previous;
  std::int64_t expected = 1;
  // One record at a time, by its number: damage of one page does not end the walk.
  std::int64_t last = 0;
  try {
    last = one_integer(damaged, "SELECT max(id) FROM measurement");
    Statement identity(
        damaged, "SELECT sensors, model, configuration, project FROM identity ORDER BY id DESC LIMIT 1");
    if (identity.step())
      whole.identify({std::string(identity.text(0)), std::string(identity.text(1)),
                      std::string(identity.text(2)), std::string(identity.text(3))});
  } catch (const DataError& error) {
    whole.rollback();
    throw DataError(fmt::format("{}: nothing can be read: {}", from, error.what()));
  }
  if (const std::int64_t most = max_records(from); last > most) {
    recovery.lost.push_back(
        fmt::format("record {}: its number is damaged: the file cannot hold so many", last));
    last = most;
  }
  const std::string select = select_records(damaged, "WHERE m.id = ?");
  for (; expected <= last; ++expected) {
    try {
      Statement row(damaged, select.c_str());
      row.bind(1, expected);
      if (!row.step()) {
        recovery.lost.push_back(fmt::format("record {}: is not there", expected));
        previous.clear();
        continue;
      }
      const Record record = read_record(row);
      // After a lost record the seal before is unknown: what is well-formed is then taken at its word.
      const bool sealed = previous.empty() && expected > 1
                              ? record.well_formed
                              : record.well_formed && record.seal == seal_of(previous, record);
      previous = record.seal;
      if (!sealed) {
        recovery.lost.push_back(fmt::format("record {}: its bytes do not match its seal", expected));
        continue;
      }
      save(record.entry, whole, recovery);
    } catch (const DataError& error) {
      recovery.lost.push_back(fmt::format("record {}: {}", expected, error.what()));
      previous.clear();
    }
  }
  save_alarms(damaged, whole, recovery);
  save_logbook(damaged, whole, recovery);
  save_files(damaged, whole, recovery);
  whole.commit();
  copy_refinement(from, to);
  return recovery;
}

}  // namespace knothe::service
