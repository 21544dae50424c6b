#pragma once
/// @file The journal: every accepted measurement, on disk before it is acknowledged (SQLite in WAL mode,
/// synchronous = FULL).
///
/// Records are sealed in a chain: seal_n = SHA-256(seal_{n−1} ‖ record n). A record that was changed, lost or
/// put in between is found when the journal is opened. What power failure tears off the end was not
/// acknowledged; how much was acknowledged stands in a small file beside it, so what is lost otherwise is
/// said. Nothing is ever taken off the disk: that a datum is released or withdrawn is a mark of its
/// own, sealed in a chain of its own.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "knothe/service/journal/alarm.hpp"
#include "knothe/service/journal/journal_file.hpp"
#include "knothe/service/journal/logbook.hpp"
#include "knothe/service/journal/measurement.hpp"

namespace knothe::service {

/// What the journal says its data are for.
struct Identity {
  std::string sensors;        ///< SHA-256 of points, components and noise
  std::string model;          ///< SHA-256 of the model file
  std::string configuration;  ///< SHA-256 of the project file's text
  std::string project;        ///< the text itself
  auto operator<=>(const Identity&) const = default;
};

/// Why a datum is in quarantine; it is not where there is no reason.
struct Quarantine {
  bool late = false;         ///< came too late
  bool implausible = false;  ///< a value was beyond the limit that held when it came
  explicit operator bool() const { return late || implausible; }
  /// As it is on disk: 0 to 3.
  [[nodiscard]] std::int64_t code() const { return (late ? 1 : 0) + (implausible ? 2 : 0); }
  [[nodiscard]] static Quarantine of_code(std::int64_t code) { return {(code & 1) != 0, (code & 2) != 0}; }
};

/// One record.
struct JournalEntry {
  std::int64_t id = 0;
  Measurement measurement;
  Quarantine quarantined;
  bool released = false;   ///< quarantined, then assimilated by request
  bool withdrawn = false;  ///< taken out by request: as if it had never come

  /// Whether it is in the posterior.
  [[nodiscard]] bool counts() const { return !withdrawn && (!quarantined || released); }
};

/// What `append` found.
enum class AppendOutcome { accepted, duplicate, conflict };
struct Appended {
  AppendOutcome outcome = AppendOutcome::accepted;
  Quarantine quarantined;   ///< the datum itself, or the one that it duplicates, and not released
  std::int64_t step = 0;    ///< of the record on disk
  std::int64_t record = 0;  ///< its number
  std::int64_t received_ms = 0;
  bool replacement = false;  ///< of a datum of the same key that was withdrawn
  std::string reason;        ///< of the quarantine, in words; for those who know the limits
};

/// A journal as it is read, also while another process writes it.
class JournalReader {
 public:
  /// Opens and verifies everything. DataError where it is not there, is damaged (names the record and says
  /// how to recover) or of a newer schema; IoError.
  explicit JournalReader(const std::string& path) : JournalReader(path, Access::read) {}
  ~JournalReader();
  JournalReader(JournalReader&&) noexcept;

  [[nodiscard]] const std::string& path() const;
  /// In hex, made at random with the journal: that of no other. Empty before schema 4.
  [[nodiscard]] const std::string& id() const;
  [[nodiscard]] std::optional<Identity> identity() const;
  /// What was acknowledged and is not there, in words; empty: nothing.
  [[nodiscard]] const std::string& lost() const;
  /// The seal of the last record, in hex: two journals with the same seal hold the same records.
  [[nodiscard]] std::string seal() const;

  [[nodiscard]] std::int64_t count() const;        ///< of records, withdrawn ones too
  [[nodiscard]] std::int64_t withdrawals() const;  ///< how many of them are withdrawn
  /// Calls `visit` for every record, in the order of their writing.
  void for_each(const std::function<void(const JournalEntry&)>& visit) const;
  [[nodiscard]] std::vector<JournalEntry> quarantined() const;
  /// The last `most` alarms that were told, in order.
  [[nodiscard]] std::vector<Alarm> alarms(std::int64_t most) const;
  /// The last of each condition, told or its end.
  [[nodiscard]] std::vector<Alarm> conditions() const;
  /// All entries, in order.
  [[nodiscard]] std::vector<LogbookEntry> logbook() const;
  /// Files of watched folders, in the order of their writing.
  [[nodiscard]] std::vector<JournalFile> files() const;

 protected:
  enum class Access { write, read };
  JournalReader(const std::string& path, Access access);
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// A journal that is written, by one process at a time: it locks the file.
class Journal : public JournalReader {
 public:
  /// Makes it if it is not there, and migrates it to the present schema. Errors as of JournalReader;
  /// DataError where another process writes it.
  explicit Journal(const std::string& path) : JournalReader(path, Access::write) {}

  /// Records for what the data are from now on. True if that differs from what was recorded last. DataError
  /// where the sensors differ: the values of this journal would mean something else.
  bool identify(const Identity& identity);
  /// Starts counted so far, this one included.
  [[nodiscard]] std::int64_t starts() const;
  /// From now on they are counted from `least` at least: events are numbered by them, and go on increasing
  /// where one journal takes the place of another.
  void raise_starts(std::int64_t least);

  /// Whether the file that is written is still the one that has the journal's name.
  [[nodiscard]] bool in_place() const;
  /// DiskFullError where it is not.
  void require_in_place() const;
  /// Moves what is in SQLite's log (NAME-wal) to the journal itself, where damage is found. Between groups;
  /// false where a reader was in the way: again later.
  bool checkpoint();

  /// Begins and ends a group of appends; `commit` returns when they are on disk. DiskFullError: nothing of
  /// the group is there. What was committed may be in a file that has gone meanwhile: `in_place`.
  void begin();
  void commit();
  void rollback() noexcept;
  /// Writes something that means nothing, inside a group: does the disk take it?
  void touch();
  /// Adds a datum inside a group. `quarantined`: if it is new. One whose key was withdrawn is new; it takes
  /// the place of that one, so it is too late only if that was.
  Appended append(const Measurement& datum, Quarantine quarantined = {});
  /// Lets a quarantined datum into the posterior, inside a group: its record before. Nothing if there is none
  /// of that name.
  std::optional<JournalEntry> release(const RecordName& name);
  /// Takes a datum out, inside a group: its record before, which says whether it had been withdrawn already.
  /// Nothing if there is none of that name.
  std::optional<JournalEntry> withdraw(const RecordName& name);
  /// Keeps an alarm, inside a group.
  void add_alarm(const Alarm& alarm);
  /// Writes an entry, inside a group: as it is on disk, with its number and time of writing.
  LogbookEntry add_entry(LogbookEntry entry);

  /// Keeps what became of a file, inside a group.
  void add_file(const JournalFile& file);

  /// Whether the last datum of that key is withdrawn; nothing where there is none.
  [[nodiscard]] std::optional<bool> withdrawn(const likelihood::DatumKey& key) const;
  /// Whether a record that is withdrawn has its key, time and payload.
  [[nodiscard]] bool has_withdrawn(const Measurement& datum) const;
  /// The `most` largest of the records that are not withdrawn, the largest first.
  [[nodiscard]] std::vector<std::int64_t> largest_seqs(const std::string& source, const std::string& session,
                                                       std::size_t most) const;
};

/// What a look at a journal tells, without verifying it.
struct JournalGlance {
  std::int64_t records = 0;
  bool finished = false;                   ///< the test was, and was not resumed
  std::optional<std::string> followed_by;  ///< the test that took its place, unless it was resumed
  std::int64_t begun_ms = 0;               ///< Unix time, of a test that was begun in a running service
  bool is_used = false;                    ///< there is more in it than that the test was begun
};
/// Also while it is written. An empty file is a journal without records. DataError where it is none, or
/// damaged.
[[nodiscard]] JournalGlance glance_at_journal(const std::string& path);

/// Copies a journal as it is at one moment to a new file, also while it is written, and verifies the copy:
/// what is in it, in words. So its refinement (verification.hpp). DataError where it is damaged, UsageError
/// where `to` is there, IoError.
[[nodiscard]] std::string backup_journal(const std::string& from, const std::string& to);

/// Copies every whole record of a damaged journal to a new one. What was lost.
struct Recovery {
  std::int64_t saved = 0;
  std::vector<std::string> lost;  ///< "record 17: …"
};
/// DataError where nothing can be read; `to` must not exist.
[[nodiscard]] Recovery recover_journal(const std::string& from, const std::string& to);

}  // namespace knothe::service
