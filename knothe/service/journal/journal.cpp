#include "knothe/service/journal/journal.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/service/journal/journal_records.hpp"
#include "knothe/service/journal/journal_schema.hpp"
#include "knothe/service/journal/sqlite.hpp"

namespace knothe::service {
namespace {

/// The lock that makes a writer the only one; it goes with the process, however that ends.
class WriterLock {
 public:
  WriterLock() = default;
  explicit WriterLock(const std::string& path) {
    const std::string name = path + ".lock";
    number_ = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    if (number_ < 0) throw system_error("could not open the journal's lock", name);
    if (::flock(number_, LOCK_EX | LOCK_NB) != 0) {
      ::close(number_);
      throw DataError(fmt::format("{}: another process writes this journal; a journal has one writer", path));
    }
  }
  ~WriterLock() {
    if (number_ >= 0) ::close(number_);
  }
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

 private:
  int number_ = -1;
};

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
};

/// The last record of a key.
struct Found {
  std::string payload;
  double time = 0;
  std::int64_t step = 0;
  Quarantine held;  ///< in quarantine still, or when it was withdrawn
  bool withdrawn = false;
};

}  // namespace

struct Journal::Implementation {
  std::string path;
  WriterLock lock;
  mutable Database database;
  Chains chains;
  std::optional<Chains> before;  ///< at `begin`
  std::int64_t starts = 0;
  std::optional<Statement> insert, find;  ///< of a writer

  Implementation(const std::string& p, Access access)
      : path(p),
        lock(access == Access::write ? WriterLock(p) : WriterLock()),
        database(p, access == Access::write ? Database::Mode::create : Database::Mode::read_only) {
    if (access == Access::write) {
      // FULL: the log is synced at every commit; EXTRA adds nothing in WAL mode.
      database.execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA trusted_schema = OFF;");
      if (is_empty(database)) migrate(database);
    }
    check_schema(database);
    verify();
    if (access == Access::write) prepare_to_write();
  }

  void prepare_to_write() {
    migrate(database);
    database.execute("UPDATE meta SET value = value + 1 WHERE key = 'starts'");
    starts = one_integer(database, "SELECT value FROM meta WHERE key = 'starts'");
    insert.emplace(database, "INSERT INTO measurement VALUES(?,?,?,?,?,?,?,?,?,?,?)");
    find.emplace(database,
                 "SELECT m.payload, m.time, m.step, m.quarantined, r.id, w.id FROM measurement m "
                 "LEFT JOIN release r ON r.measurement = m.id LEFT JOIN withdrawal w ON w.measurement = m.id "
                 "WHERE m.source = ? AND m.session = ? AND m.seq = ? ORDER BY m.id DESC LIMIT 1");
  }

  [[noreturn]] void damaged(const std::string& what) const {
    throw DataError(
        fmt::format("{}: {}; `knothe recover {} -o NEW` saves the whole records", path, what, path));
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

  std::optional<Found> find_last(const assimilation::DatumKey& key) {
    find->reset();
    find->bind(1, std::string_view(key.source)).bind(2, std::string_view(key.session)).bind(3, key.seq);
    std::optional<Found> found;
    if (find->step())
      found = {std::string(find->text(0)), find->number(1), find->integer(2),
               find->is_null(4) ? Quarantine::of_code(find->integer(3)) : Quarantine(), !find->is_null(5)};
    find->reset();
    return found;
  }

  std::optional<JournalEntry> last_entry(const assimilation::DatumKey& key) {
    Statement row(
        database,
        select_records(database,
                       "WHERE m.source = ? AND m.session = ? AND m.seq = ? ORDER BY m.id DESC LIMIT 1")
            .c_str());
    row.bind(1, std::string_view(key.source)).bind(2, std::string_view(key.session)).bind(3, key.seq);
    if (!row.step()) return std::nullopt;
    return read_record(row).entry;
  }
};

Journal::Journal(const std::string& path, Access access) {
  if (access == Access::read && !std::filesystem::exists(path))
    throw DataError(fmt::format("{}: there is no such journal", path));
  const auto folder = std::filesystem::path(path).parent_path();
  std::error_code error;
  if (access == Access::write && !folder.empty()) std::filesystem::create_directories(folder, error);
  implementation_ = std::make_unique<Implementation>(path, access);
}
Journal::~Journal() = default;
Journal::Journal(Journal&&) noexcept = default;

bool Journal::identify(const Identity& identity) {
  const auto last = this->identity();
  if (last == identity) return false;
  if (last && last->sensors != identity.sensors)
    throw DataError(
        fmt::format("{}: its data are of other sensors (points, components or noise differ); give the data "
                    "file that it was "
                    "begun with, or begin another journal ([serve] journal)",
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

std::optional<Identity> Journal::identity() const {
  Statement last(implementation_->database,
                 "SELECT sensors, model, configuration, project FROM identity ORDER BY id DESC LIMIT 1");
  if (!last.step()) return std::nullopt;
  return Identity{std::string(last.text(0)), std::string(last.text(1)), std::string(last.text(2)),
                  std::string(last.text(3))};
}

std::int64_t Journal::starts() const {
  return implementation_->starts;
}

void Journal::begin() {
  Implementation& i = *implementation_;
  i.before.reset();  // what cannot be remembered cannot be gone back to
  i.before = i.chains;
  i.database.execute("BEGIN IMMEDIATE");
}

void Journal::touch() {
  implementation_->database.execute(
      "INSERT INTO meta VALUES('touched', 1) ON CONFLICT(key) DO UPDATE SET value = value + 1");
}

void Journal::commit() {
  implementation_->database.execute("COMMIT");
  implementation_->before.reset();
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
    return {same ? Outcome::duplicate : Outcome::conflict, there->held, there->step, 0, false, {}};
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
  return {Outcome::accepted, quarantined, datum.step, record.entry.measurement.received_ms,
          there.has_value(), {}};
}

std::optional<JournalEntry> Journal::release(const assimilation::DatumKey& key) {
  Implementation& i = *implementation_;
  auto entry = i.last_entry(key);
  if (!entry || !entry->quarantined || entry->withdrawn) return std::nullopt;
  if (!entry->released) i.mark("release", i.chains.releases, entry->id);
  return entry;
}

std::optional<JournalEntry> Journal::withdraw(const assimilation::DatumKey& key) {
  Implementation& i = *implementation_;
  auto entry = i.last_entry(key);
  if (entry && !entry->withdrawn) i.mark("withdrawal", i.chains.withdrawals, entry->id);
  return entry;
}

std::int64_t Journal::count() const {
  return implementation_->chains.records.count;
}

std::int64_t Journal::withdrawals() const {
  return implementation_->chains.withdrawals.count;
}

std::optional<std::int64_t> Journal::largest_seq(const std::string& source,
                                                 const std::string& session) const {
  Statement row(implementation_->database,
                select_records(implementation_->database,
                               "WHERE m.source = ? AND m.session = ? AND w.id IS NULL ORDER BY m.seq DESC "
                               "LIMIT 1")
                    .c_str());
  row.bind(1, std::string_view(source)).bind(2, std::string_view(session));
  if (!row.step()) return std::nullopt;
  return row.integer(3);
}

void Journal::for_each(const std::function<void(const JournalEntry&)>& visit) const {
  Statement rows(implementation_->database,
                 select_records(implementation_->database, "ORDER BY m.id").c_str());
  while (rows.step()) visit(read_record(rows).entry);
}

std::vector<JournalEntry> Journal::quarantined() const {
  std::vector<JournalEntry> entries;
  Statement rows(
      implementation_->database,
      select_records(implementation_->database, "WHERE m.quarantined <> 0 AND r.id IS NULL ORDER BY m.id")
          .c_str());
  while (rows.step())
    if (JournalEntry entry = read_record(rows).entry; !entry.withdrawn) entries.push_back(std::move(entry));
  return entries;
}

const std::string& Journal::path() const {
  return implementation_->path;
}

std::string Journal::seal() const {
  Digest digest{};
  const std::string& seal = implementation_->chains.records.seal;
  if (seal.size() == digest.size()) std::copy(seal.begin(), seal.end(), digest.begin());
  return to_hex(digest);
}

}  // namespace knothe::service
