#include "knothe/service/journal/journal.hpp"

#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <utility>

#include <sqlite3.h>

#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/service/journal/journal_place.hpp"
#include "knothe/service/journal/journal_records.hpp"
#include "knothe/service/journal/journal_schema.hpp"
#include "knothe/service/journal/sqlite.hpp"

namespace knothe::service {
namespace {

constexpr std::chrono::seconds k_mark_rest{1};  // the longest that a mark is not on disk

std::string hex_of(const std::string& seal) {
  Digest digest{};
  if (seal.size() == digest.size()) std::copy(seal.begin(), seal.end(), digest.begin());
  return to_hex(digest);
}

std::int64_t now_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

/// Rows that are numbered from 1 without gaps, each sealed with the one before.
struct Chain {
  std::string seal;  ///< of the last
  std::int64_t count = 0;
};
struct Chains {
  Chain records, releases;
  Chain withdrawals{"withdrawals", 0};  ///< begins otherwise: no release can be taken for one
  Chain alarms{"alarms", 0};
  Chain logbook{"logbook", 0};
  Chain files{"files", 0};
};

/// The last record of a key.
struct Found {
  std::int64_t id = 0;
  std::string payload;
  double time = 0;
  std::int64_t step = 0;
  Quarantine held;  ///< in quarantine still, or when it was withdrawn
  bool withdrawn = false;
};

}  // namespace

struct JournalReader::Implementation {
  std::string path;
  std::optional<Acknowledged>
      acknowledged;  ///< read first: a reader beside a writer then sees at least that much
  WriterLock lock;   ///< before the database: closed after it
  mutable Database database;
  std::string id, lost;
  std::string mark_path = mark_path_of(path), log_path;
  Acknowledged told;                     ///< what the mark says next
  std::optional<FileIdentity> log;       ///< NAME-wal, once something was written
  std::optional<FileHead> head;          ///< of the file, as this writer left it
  std::int64_t number = 0, id_page = 1;  ///< `id`, and where it is
  bool is_marked = false;                ///< there was a mark beside it
  std::chrono::steady_clock::time_point mark_synced;
  Chains chains;
  std::optional<Chains> before;  ///< at `begin`
  std::int64_t starts = 0;
  std::string seal_at_mark;               ///< of the record that was acknowledged last, in hex
  std::optional<Statement> insert, find;  ///< of a writer

  Implementation(const std::string& p, Access access)
      : path(p),
        acknowledged(read_mark(p)),
        lock(access == Access::write ? WriterLock(p) : WriterLock()),
        database(p, access == Access::write ? Database::Mode::create : Database::Mode::read_only) {
    if (access == Access::write) {
      // FULL: the log is synced at every commit; EXTRA adds nothing in WAL mode.
      database.execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA trusted_schema = OFF;");
      if (is_empty(database)) migrate(database);
    }
    check_schema(database);
    verify();
    if (access == Access::write) migrate(database);
    if (schema_of(database) >= 4) {
      number = one_integer(database, "SELECT value FROM meta WHERE key = 'journal'");
      id = fmt::format("{:016x}", number);
    }
    is_marked = one_integer(database, "SELECT value FROM meta WHERE key = 'marked'") != 0;
    find_losses();
    if (access == Access::write) prepare_to_write();
  }

  void prepare_to_write() {
    told.journal = id;
    std::error_code ignored;
    log_path = std::filesystem::weakly_canonical(path, ignored).string() + "-wal";
    if (!is_marked) {  // first the mark, so that none is missed that has never been
      acknowledge(true);
      sync_folder_of(path);
      database.execute("INSERT INTO meta VALUES('marked', 1)");
    }
    database.execute("UPDATE meta SET value = value + 1 WHERE key = 'starts'");
    id_page = one_integer(database, "SELECT rootpage FROM sqlite_master WHERE name = 'meta'");
    starts = one_integer(database, "SELECT value FROM meta WHERE key = 'starts'");
    insert.emplace(database, "INSERT INTO measurement VALUES(?,?,?,?,?,?,?,?,?,?,?)");
    find.emplace(database,
                 "SELECT m.id, m.payload, m.time, m.step, m.quarantined, r.id, w.id FROM measurement m "
                 "LEFT JOIN release r ON r.measurement = m.id LEFT JOIN withdrawal w ON w.measurement = m.id "
                 "WHERE m.source = ? AND m.session = ? AND m.seq = ? ORDER BY m.id DESC LIMIT 1");
    (void)checkpoint();  // what a journal is, is then never in its log alone
    acknowledge(true);
    sync_folder_of(path);
  }

  bool checkpoint() {
    sqlite3_busy_timeout(database.handle(), 0);
    bool whole = false;
    {
      Statement statement(database, "PRAGMA wal_checkpoint(TRUNCATE)");
      whole = statement.step() && statement.integer(0) == 0;
    }
    sqlite3_busy_timeout(database.handle(), k_busy_timeout_ms);
    note_head();
    if (!told.journal.empty()) acknowledge(true);
    return whole;
  }

  [[nodiscard]] bool in_place() const {
    return file_identity(path) == lock.file() && (!log || file_identity(log_path) == log) && is_as_left();
  }

  /// Whether nobody else has written into the file: truncated it, or copied another journal over it.
  [[nodiscard]] bool is_as_left() const {
    if (!head) return true;
    const auto now = lock.head(number, id_page);
    return now && head->may_become(*now);
  }

  /// What this writer leaves only grows: a file that has shrunk meanwhile is somebody else's work.
  void note_head() noexcept {
    const auto now = lock.head(number, id_page);
    if (now && (!head || now->size >= head->size)) head = now;
  }

  void require_in_place() const {
    if (!in_place())
      throw DiskFullError(
          fmt::format("{}: the journal was deleted, renamed, replaced or overwritten while it is written; "
                      "put it back, or "
                      "restart the service to begin another",
                      path));
  }

  /// Before the first write: the mark is then replaced.
  void find_losses() {
    if (!acknowledged) {
      if (is_marked)
        lost = fmt::format(
            "{}, which says how much was acknowledged, is missing or damaged: whether records "
            "are lost cannot be told",
            mark_path);
      return;
    }
    if (acknowledged->journal != id) {
      // With other records in it somebody has put it there.
      if (!id.empty() && acknowledged->records > 0 && chains.records.count == 0)
        lost = fmt::format("the journal that had this name, with {} records, no longer exists",
                           acknowledged->records);
      return;
    }
    const auto missing = [&](const char* what, std::int64_t there, std::int64_t told) {
      if (there >= told) return;
      const std::string which = there + 1 == told ? fmt::format("{} {}", what, told)
                                                  : fmt::format("{}s {} to {}", what, there + 1, told);
      lost += (lost.empty() ? "" : ", ") + which;
    };
    missing("record", chains.records.count, acknowledged->records);
    missing("release", chains.releases.count, acknowledged->releases);
    missing("withdrawal", chains.withdrawals.count, acknowledged->withdrawals);
    missing("alarm", chains.alarms.count, acknowledged->alarms);
    missing("logbook entry", chains.logbook.count, acknowledged->entries);
    if (chains.records.count >= acknowledged->records && seal_at_mark != acknowledged->seal &&
        acknowledged->records > 0)
      lost = fmt::format("record {} and those before it as they were", acknowledged->records);
    if (!lost.empty())
      lost = fmt::format(
          "acknowledged and gone: {}; the journal's log ({}-wal) was damaged or lost, or an older "
          "journal was put in its place",
          lost, path);
  }

  /// After a commit, so nothing is allocated: what is on disk cannot be taken back.
  void acknowledge(bool synced = false) noexcept {
    told.records = chains.records.count, told.releases = chains.releases.count;
    told.withdrawals = chains.withdrawals.count, told.alarms = chains.alarms.count;
    told.entries = chains.logbook.count;
    const auto now = std::chrono::steady_clock::now();
    synced = synced || now - mark_synced > k_mark_rest;
    write_mark(mark_path, told, chains.records.seal, synced);
    if (synced) mark_synced = now;
    if (!log) log = file_identity(log_path);
    note_head();
  }

  [[noreturn]] void damaged(const std::string& what) const {
    throw DataError(
        fmt::format("{}: {}; `knothe recover {} -o NEW` saves the intact records", path, what, path));
  }

  void verify() {
    {
      Statement integrity(database, "PRAGMA integrity_check(1)");
      if (!integrity.step() || integrity.text(0) != "ok")
        damaged(fmt::format("the journal is damaged: {}", integrity.text(0)));
    }
    Chain& records = chains.records;
    Statement rows(database, select_records(database, "ORDER BY m.id").c_str());
    while (rows.step()) {
      const Record record = read_record(rows);
      if (!record.well_formed || record.entry.id != records.count + 1 ||
          record.seal != seal_of(records.seal, record))
        damaged(
            fmt::format("record {} of the journal is damaged, or one before it is lost", records.count + 1));
      records = {record.seal, record.entry.id};
      if (acknowledged && record.entry.id == acknowledged->records) seal_at_mark = hex_of(record.seal);
    }
    verify_marks("release", chains.releases);
    if (schema_of(database) < 3) return;
    verify_marks("withdrawal", chains.withdrawals);
    Statement twice(database,
                    "SELECT max(m.id) FROM measurement m LEFT JOIN withdrawal w ON w.measurement = m.id "
                    "WHERE w.id IS NULL GROUP BY m.source, m.session, m.seq HAVING count(*) > 1 LIMIT 1");
    if (twice.step())
      damaged(fmt::format("record {} of the journal has the key of one before it, whose withdrawal is lost",
                          twice.integer(0)));
    if (schema_of(database) >= 4) verify_alarms();
    verify_logbook();
    verify_files();
  }

  void verify_logbook() {
    Chain& chain = chains.logbook;
    visit_logbook(database, [&](const LogbookEntry& entry, const std::string& seal) {
      if (entry.number != chain.count + 1 || seal != entry_seal(chain.seal, entry))
        damaged(fmt::format("entry {} of the journal's logbook is damaged", chain.count + 1));
      chain = {seal, entry.number};
      return true;
    });
  }

  void verify_files() {
    Chain& chain = chains.files;
    visit_files(database, [&](std::int64_t number, const JournalFile& file, const std::string& seal) {
      if (number != chain.count + 1 || seal != file_seal(chain.seal, number, file))
        damaged(fmt::format("file {} of the journal is damaged", chain.count + 1));
      chain = {seal, number};
      return true;
    });
  }

  void verify_alarms() {
    Chain& chain = chains.alarms;
    Statement rows(
        database,
        "SELECT id, seal, event, step, severity, kind, message, condition, raised FROM alarm ORDER BY id");
    while (rows.step()) {
      const std::int64_t number = rows.integer(0);
      if (number != chain.count + 1 || rows.text(1) != alarm_seal(chain.seal, number, read_alarm(rows, 2)))
        damaged(fmt::format("alarm {} of the journal is damaged", chain.count + 1));
      chain = {std::string(rows.text(1)), number};
    }
  }

  /// Releases or withdrawals.
  void verify_marks(const char* table, Chain& chain) {
    Statement rows(database, fmt::format("SELECT id, measurement, seal FROM {} ORDER BY id", table).c_str());
    while (rows.step()) {
      const std::int64_t id = rows.integer(0), record = rows.integer(1);
      if (id != chain.count + 1 || record < 1 || record > chains.records.count ||
          rows.text(2) != mark_seal(chain.seal, id, record))
        damaged(fmt::format("{} {} of the journal is damaged", table, chain.count + 1));
      chain = {std::string(rows.text(2)), id};
    }
  }

  void mark(const char* table, Chain& chain, std::int64_t record) {
    const std::string seal = mark_seal(chain.seal, chain.count + 1, record);
    Statement row(database, fmt::format("INSERT INTO {} VALUES(?,?,?)", table).c_str());
    row.bind(1, chain.count + 1).bind(2, record).bind_blob(3, seal);
    row.run();
    chain = {seal, chain.count + 1};
  }

  std::optional<Found> find_last(const likelihood::DatumKey& key) {
    find->reset();
    find->bind(1, std::string_view(key.source)).bind(2, std::string_view(key.session)).bind(3, key.seq);
    std::optional<Found> found;
    if (find->step())
      found = {find->integer(0),
               std::string(find->text(1)),
               find->number(2),
               find->integer(3),
               find->is_null(5) ? Quarantine::of_code(find->integer(4)) : Quarantine(),
               !find->is_null(6)};
    find->reset();
    return found;
  }

  std::optional<JournalEntry> entry_of(const RecordName& name) {
    std::string condition = "WHERE m.source = ? AND m.session = ? AND m.seq = ? ";
    if (name.which == RecordName::Which::numbered) condition += "AND m.id = ? ";
    condition += name.which == RecordName::Which::first ? "ORDER BY m.id" : "ORDER BY m.id DESC";
    Statement row(database, select_records(database, (condition + " LIMIT 1").c_str()).c_str());
    const likelihood::DatumKey& key = name.key;
    row.bind(1, std::string_view(key.source)).bind(2, std::string_view(key.session)).bind(3, key.seq);
    if (name.which == RecordName::Which::numbered) row.bind(4, name.number);
    if (!row.step()) return std::nullopt;
    return read_record(row).entry;
  }
};

JournalReader::JournalReader(const std::string& path, Access access) {
  if (access == Access::read && !std::filesystem::exists(path))
    throw DataError(fmt::format("{}: there is no such journal", path));
  const auto folder = std::filesystem::path(path).parent_path();
  std::error_code error;
  if (access == Access::write && !folder.empty()) std::filesystem::create_directories(folder, error);
  implementation_ = std::make_unique<Implementation>(path, access);
}
JournalReader::~JournalReader() = default;
JournalReader::JournalReader(JournalReader&&) noexcept = default;

bool Journal::identify(const Identity& identity) {
  const auto last = this->identity();
  if (last == identity) return false;
  if (last && last->sensors != identity.sensors)
    throw DataError(
        fmt::format("{}: its data are of other sensors (points, components or noise differ); give the data "
                    "file that it was begun with, or begin another journal ([serve] journal)",
                    path()));
  Database& database = implementation_->database;
  Statement insert(database,
                   "INSERT INTO identity(sensors, model, configuration, project, after) VALUES(?,?,?,?,?)");
  insert.bind(1, std::string_view(identity.sensors)).bind(2, std::string_view(identity.model));
  insert.bind(3, std::string_view(identity.configuration)).bind(4, std::string_view(identity.project));
  insert.bind(5, implementation_->chains.records.count);
  insert.run();
  return last.has_value();
}

std::optional<Identity> JournalReader::identity() const {
  Statement last(implementation_->database,
                 "SELECT sensors, model, configuration, project FROM identity ORDER BY id DESC LIMIT 1");
  if (!last.step()) return std::nullopt;
  return Identity{std::string(last.text(0)), std::string(last.text(1)), std::string(last.text(2)),
                  std::string(last.text(3))};
}

std::int64_t Journal::starts() const {
  return implementation_->starts;
}

void Journal::raise_starts(std::int64_t least) {
  Implementation& i = *implementation_;
  if (i.starts >= least) return;
  Statement row(i.database, "UPDATE meta SET value = ? WHERE key = 'starts'");
  row.bind(1, least);
  row.run();
  i.starts = least;
}

void Journal::begin() {
  Implementation& i = *implementation_;
  i.before.reset();  // what cannot be remembered cannot be gone back to
  i.before = i.chains;
  i.require_in_place();
  i.database.execute("BEGIN IMMEDIATE");
}

void Journal::touch() {
  implementation_->database.execute(
      "INSERT INTO meta VALUES('touched', 1) ON CONFLICT(key) DO UPDATE SET value = value + 1");
}

void Journal::commit() {
  Implementation& i = *implementation_;
  i.database.execute("COMMIT");
  i.before.reset();
  i.acknowledge();
}

const std::string& JournalReader::id() const {
  return implementation_->id;
}

const std::string& JournalReader::lost() const {
  return implementation_->lost;
}

bool Journal::in_place() const {
  return implementation_->in_place();
}

void Journal::require_in_place() const {
  implementation_->require_in_place();
}

bool Journal::checkpoint() {
  return implementation_->checkpoint();
}

void Journal::add_alarm(const Alarm& alarm) {
  Implementation& i = *implementation_;
  Chain& chain = i.chains.alarms;
  const std::string seal = alarm_seal(chain.seal, chain.count + 1, alarm);
  Statement row(i.database, "INSERT INTO alarm VALUES(?,?,?,?,?,?,?,?,?)");
  row.bind(1, chain.count + 1).bind(2, alarm.id).bind(3, alarm.step);
  row.bind(4, std::string_view(alarm.severity)).bind(5, std::string_view(alarm.kind));
  row.bind(6, std::string_view(alarm.message)).bind(7, std::string_view(alarm.condition));
  row.bind(8, alarm.raised_ms).bind_blob(9, seal);
  row.run();
  chain = {seal, chain.count + 1};
}

std::vector<Alarm> JournalReader::alarms(std::int64_t most) const {
  std::vector<Alarm> found;
  if (schema_of(implementation_->database) < 4) return found;
  Statement rows(implementation_->database,
                 "SELECT event, step, severity, kind, message, condition, raised FROM alarm WHERE severity "
                 "<> '' ORDER BY id DESC LIMIT ?");
  rows.bind(1, most);
  while (rows.step()) found.push_back(read_alarm(rows, 0));
  return {found.rbegin(), found.rend()};
}

std::vector<Alarm> JournalReader::conditions() const {
  std::vector<Alarm> found;
  if (schema_of(implementation_->database) < 4) return found;
  Statement rows(implementation_->database,
                 "SELECT event, step, severity, kind, message, condition, raised FROM alarm WHERE id IN "
                 "(SELECT max(id) FROM alarm WHERE condition <> '' GROUP BY condition) ORDER BY id");
  while (rows.step()) found.push_back(read_alarm(rows, 0));
  return found;
}

LogbookEntry Journal::add_entry(LogbookEntry entry) {
  Implementation& i = *implementation_;
  Chain& chain = i.chains.logbook;
  entry.number = chain.count + 1;
  if (entry.written_ms == 0) entry.written_ms = now_ms();
  const std::string seal = entry_seal(chain.seal, entry), kind = to_text(entry.kind);
  Statement row(i.database, "INSERT INTO logbook VALUES(?,?,?,?,?,?,?,?)");
  row.bind(1, entry.number).bind(2, std::string_view(kind)).bind(3, entry.subject).bind(4, entry.time);
  row.bind(5, std::string_view(entry.author)).bind(6, std::string_view(entry.text));
  row.bind(7, entry.written_ms).bind_blob(8, seal);
  row.run();
  chain = {seal, entry.number};
  return entry;
}

void Journal::add_file(const JournalFile& file) {
  Implementation& i = *implementation_;
  Chain& chain = i.chains.files;
  const std::string seal = file_seal(chain.seal, chain.count + 1, file), outcome = to_text(file.outcome);
  Statement row(i.database, "INSERT INTO file VALUES(?,?,?,?,?,?,?)");
  row.bind(1, chain.count + 1).bind(2, std::string_view(file.source)).bind(3, std::string_view(file.name));
  row.bind(4, std::string_view(file.digest)).bind(5, std::string_view(outcome));
  row.bind(6, file.seq).bind_blob(7, seal);
  row.run();
  chain = {seal, chain.count + 1};
}

std::optional<bool> Journal::withdrawn(const likelihood::DatumKey& key) const {
  const auto found = implementation_->find_last(key);
  return found ? std::optional(found->withdrawn) : std::nullopt;
}

bool Journal::has_withdrawn(const Measurement& datum) const {
  Database& database = implementation_->database;
  Statement rows(
      database,
      select_records(database,
                     "WHERE m.source = ? AND m.session = ? AND m.seq = ? AND m.time = ? AND w.id IS NOT NULL")
          .c_str());
  rows.bind(1, std::string_view(datum.key.source)).bind(2, std::string_view(datum.key.session));
  rows.bind(3, datum.key.seq).bind(4, datum.time);
  const std::string payload = datum.payload();
  while (rows.step())
    if (read_record(rows).payload == payload) return true;
  return false;
}

std::vector<JournalFile> JournalReader::files() const {
  std::vector<JournalFile> files;
  visit_files(implementation_->database, [&](std::int64_t, const JournalFile& file, const std::string&) {
    files.push_back(file);
    return true;
  });
  return files;
}

std::vector<LogbookEntry> JournalReader::logbook() const {
  std::vector<LogbookEntry> entries;
  visit_logbook(implementation_->database, [&](const LogbookEntry& entry, const std::string&) {
    entries.push_back(entry);
    return true;
  });
  return entries;
}

void Journal::rollback() noexcept {
  Implementation& i = *implementation_;
  try {
    i.database.execute("ROLLBACK");
  } catch (const std::exception&) {
    // SQLite has rolled back by itself: that is what a full disk does.
  }
  if (i.before) i.chains = *std::exchange(i.before, std::nullopt);
}

Appended Journal::append(const Measurement& datum, Quarantine quarantined) {
  Implementation& i = *implementation_;
  Record record;
  record.payload = datum.payload();
  const auto there = i.find_last(datum.key);
  if (there && !there->withdrawn) {
    const bool same = there->payload == record.payload && there->time == datum.time;
    return {same ? AppendOutcome::duplicate : AppendOutcome::conflict,
            there->held,
            there->step,
            there->id,
            0,
            false,
            {}};
  }
  if (there && !there->held.late) quarantined.late = false;
  record.entry.id = i.chains.records.count + 1;
  record.entry.measurement.key = datum.key;
  record.entry.measurement.time = datum.time;
  record.entry.measurement.step = datum.step;
  record.entry.measurement.noise = datum.noise;
  record.entry.quarantined = quarantined;
  record.entry.measurement.received_ms = now_ms();
  const std::string seal = seal_of(i.chains.records.seal, record);
  Statement& insert = *i.insert;
  insert.reset();
  insert.bind(1, record.entry.id).bind(2, std::string_view(datum.key.source));
  insert.bind(3, std::string_view(datum.key.session))
      .bind(4, datum.key.seq)
      .bind(5, datum.time)
      .bind(6, datum.step);
  insert.bind_blob(7, record.payload)
      .bind(8, quarantined.code())
      .bind(9, record.entry.measurement.received_ms);
  insert.bind_blob(10, seal);
  if (datum.noise.empty()) {
    insert.bind_null(11);
  } else {
    insert.bind_blob(11, datum.noise);
  }
  insert.run();
  i.chains.records = {seal, record.entry.id};
  return {
      AppendOutcome::accepted, quarantined, datum.step, record.entry.id, record.entry.measurement.received_ms,
      there.has_value(),       {}};
}

std::optional<JournalEntry> Journal::release(const RecordName& name) {
  Implementation& i = *implementation_;
  auto entry = i.entry_of(name);
  if (!entry || !entry->quarantined || entry->withdrawn) return std::nullopt;
  if (!entry->released) i.mark("release", i.chains.releases, entry->id);
  return entry;
}

std::optional<JournalEntry> Journal::withdraw(const RecordName& name) {
  Implementation& i = *implementation_;
  auto entry = i.entry_of(name);
  if (entry && !entry->withdrawn) i.mark("withdrawal", i.chains.withdrawals, entry->id);
  return entry;
}

std::int64_t JournalReader::count() const {
  return implementation_->chains.records.count;
}

std::int64_t JournalReader::withdrawals() const {
  return implementation_->chains.withdrawals.count;
}

std::vector<std::int64_t> Journal::largest_seqs(const std::string& source, const std::string& session,
                                                std::size_t most) const {
  Statement row(implementation_->database,
                select_records(implementation_->database,
                               "WHERE m.source = ? AND m.session = ? AND w.id IS NULL ORDER BY m.seq DESC "
                               "LIMIT ?")
                    .c_str());
  row.bind(1, std::string_view(source)).bind(2, std::string_view(session)).bind(3, std::int64_t(most));
  std::vector<std::int64_t> seqs;
  while (row.step()) seqs.push_back(row.integer(3));
  return seqs;
}

void JournalReader::for_each(const std::function<void(const JournalEntry&)>& visit) const {
  Statement rows(implementation_->database,
                 select_records(implementation_->database, "ORDER BY m.id").c_str());
  while (rows.step()) visit(read_record(rows).entry);
}

std::vector<JournalEntry> JournalReader::quarantined() const {
  std::vector<JournalEntry> entries;
  Statement rows(
      implementation_->database,
      select_records(implementation_->database, "WHERE m.quarantined <> 0 AND r.id IS NULL ORDER BY m.id")
          .c_str());
  while (rows.step())
    if (JournalEntry entry = read_record(rows).entry; !entry.withdrawn) entries.push_back(std::move(entry));
  return entries;
}

const std::string& JournalReader::path() const {
  return implementation_->path;
}

std::string JournalReader::seal() const {
  return hex_of(implementation_->chains.records.seal);
}

}  // namespace knothe::service
