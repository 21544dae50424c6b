#include "knothe/service/journal/journal.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/service/journal/journal_records.hpp"
#include "knothe/service/journal/sqlite.hpp"

namespace knothe::service {
namespace {

constexpr std::int64_t k_schema = 2;
constexpr std::int64_t k_application = 0x6b6e6f74;  // "knot"

/// From an empty file to schema 1.
constexpr const char* k_schema_1 = R"(
  CREATE TABLE meta(key TEXT PRIMARY KEY, value INTEGER) WITHOUT ROWID;
  CREATE TABLE identity(id INTEGER PRIMARY KEY, sensors TEXT NOT NULL, model TEXT NOT NULL,
                        configuration TEXT NOT NULL, project TEXT NOT NULL, after INTEGER NOT NULL);
  CREATE TABLE measurement(id INTEGER PRIMARY KEY, source TEXT NOT NULL, session TEXT NOT NULL,
                           seq INTEGER NOT NULL, time REAL NOT NULL, step INTEGER NOT NULL,
                           payload BLOB NOT NULL, quarantined INTEGER NOT NULL, received INTEGER NOT NULL,
                           seal BLOB NOT NULL, UNIQUE(source, session, seq));
  CREATE TABLE release(id INTEGER PRIMARY KEY, measurement INTEGER NOT NULL UNIQUE, seal BLOB NOT NULL);
  INSERT INTO meta VALUES('starts', 0);
  PRAGMA application_id = 0x6b6e6f74;
  PRAGMA user_version = 1;
)";

/// From schema 1 to 2: a measurement's own noise. A journal of schema 1 that is only read stays as it is.
constexpr const char* k_schema_2 = R"(
  ALTER TABLE measurement ADD COLUMN noise BLOB;
  PRAGMA user_version = 2;
)";

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

}  // namespace

struct Journal::Implementation {
  std::string path;
  WriterLock lock;
  mutable Database database;
  std::string seal, last_release_seal;
  std::string seal_before, release_seal_before;  ///< at `begin`
  std::int64_t count = 0, releases = 0, count_before = 0, releases_before = 0;
  std::int64_t starts = 0;
  std::optional<Statement> insert, find;

  Implementation(const std::string& p, Access access)
      : path(p),
        lock(access == Access::write ? WriterLock(p) : WriterLock()),
        database(p, access == Access::write ? Database::Mode::create : Database::Mode::read_only) {
    if (access == Access::write) {
      // FULL: the log is synced at every commit; EXTRA adds nothing in WAL mode.
      database.execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA trusted_schema = OFF;");
      if (one_integer(database, "PRAGMA user_version") == 0 &&
          one_integer(database, "SELECT count(*) FROM sqlite_master") == 0) {
        database.execute("BEGIN IMMEDIATE");
        database.execute(k_schema_1);
        database.execute("COMMIT");
      }
    }
    check_schema();
    verify();
    if (access == Access::write) {
      if (one_integer(database, "PRAGMA user_version") == 1) {
        database.execute("BEGIN IMMEDIATE");
        database.execute(k_schema_2);
        database.execute("COMMIT");
      }
      database.execute("UPDATE meta SET value = value + 1 WHERE key = 'starts'");
      starts = one_integer(database, "SELECT value FROM meta WHERE key = 'starts'");
      insert.emplace(database, "INSERT INTO measurement VALUES(?,?,?,?,?,?,?,?,?,?,?)");
    }
    find.emplace(database,
                 "SELECT id, payload, time, step, quarantined FROM measurement WHERE source = ? AND session "
                 "= ? AND seq = ?");
  }

  void check_schema() {
    if (one_integer(database, "PRAGMA application_id") != k_application)
      throw DataError(fmt::format("{}: is a database, but not a journal of knothe", path));
    const std::int64_t version = one_integer(database, "PRAGMA user_version");
    if (version > k_schema)
      throw DataError(fmt::format("{}: journal of schema {}, this knothe knows up to {}: use a newer knothe",
                                  path, version, k_schema));
    if (version < 1) throw DataError(fmt::format("{}: journal of unknown schema {}", path, version));
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
    Statement rows(database, select_records(database, "ORDER BY m.id").c_str());
    while (rows.step()) {
      const Record record = read_record(rows);
      if (!record.well_formed || record.entry.id != count + 1 || record.seal != seal_of(seal, record))
        damaged(fmt::format("record {} of the journal is damaged, or one before it is lost", count + 1));
      seal = record.seal;
      ++count;
    }
    Statement released(database, "SELECT id, measurement, seal FROM release ORDER BY id");
    while (released.step()) {
      if (released.integer(0) != releases + 1 || released.integer(1) < 1 || released.integer(1) > count ||
          released.text(2) != release_seal(last_release_seal, releases + 1, released.integer(1)))
        damaged(fmt::format("release {} of the journal is damaged", releases + 1));
      last_release_seal = released.text(2);
      ++releases;
    }
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
  insert.bind(5, implementation_->count);
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
  i.seal_before = i.seal, i.release_seal_before = i.last_release_seal;
  i.count_before = i.count, i.releases_before = i.releases;
  i.database.execute("BEGIN IMMEDIATE");
}

void Journal::touch() {
  implementation_->database.execute(
      "INSERT INTO meta VALUES('touched', 1) ON CONFLICT(key) DO UPDATE SET value = value + 1");
}

void Journal::commit() {
  implementation_->database.execute("COMMIT");
}

void Journal::rollback() noexcept {
  Implementation& i = *implementation_;
  try {
    i.database.execute("ROLLBACK");
  } catch (const std::exception&) {
    // SQLite has rolled back by itself: that is what a full disk does.
  }
  i.seal = i.seal_before, i.last_release_seal = i.release_seal_before;
  i.count = i.count_before, i.releases = i.releases_before;
}

Appended Journal::append(const Measurement& datum, bool quarantined) {
  Implementation& i = *implementation_;
  Record record;
  record.payload = datum.payload();
  Statement& find = *i.find;
  find.reset();
  find.bind(1, std::string_view(datum.key.source))
      .bind(2, std::string_view(datum.key.session))
      .bind(3, datum.key.seq);
  if (find.step()) {
    const bool same = find.text(1) == record.payload && find.number(2) == datum.time;
    Appended there{same ? Outcome::duplicate : Outcome::conflict, find.integer(4) != 0, find.integer(3), 0};
    const std::int64_t id = find.integer(0);
    find.reset();
    if (there.quarantined) {
      Statement released(i.database, "SELECT 1 FROM release WHERE measurement = ?");
      released.bind(1, id);
      if (released.step()) there.quarantined = false;
    }
    return there;
  }
  find.reset();
  record.entry.id = i.count + 1;
  record.entry.measurement.key = datum.key;
  record.entry.measurement.time = datum.time;
  record.entry.measurement.step = datum.step;
  record.entry.measurement.noise = datum.noise;
  record.entry.quarantined = quarantined;
  record.entry.measurement.received_ms = now_ms();
  const std::string seal = seal_of(i.seal, record);
  Statement& insert = *i.insert;
  insert.reset();
  insert.bind(1, record.entry.id).bind(2, std::string_view(datum.key.source));
  insert.bind(3, std::string_view(datum.key.session))
      .bind(4, datum.key.seq)
      .bind(5, datum.time)
      .bind(6, datum.step);
  insert.bind_blob(7, record.payload)
      .bind(8, static_cast<std::int64_t>(quarantined))
      .bind(9, record.entry.measurement.received_ms);
  insert.bind_blob(10, seal);
  if (datum.noise.empty()) {
    insert.bind_null(11);
  } else {
    insert.bind_blob(11, datum.noise);
  }
  insert.run();
  i.seal = seal;
  ++i.count;
  return {Outcome::accepted, quarantined, datum.step, record.entry.measurement.received_ms};
}

std::optional<JournalEntry> Journal::release(const assimilation::DatumKey& key) {
  Implementation& i = *implementation_;
  Statement row(
      i.database,
      select_records(i.database, "WHERE m.source = ? AND m.session = ? AND m.seq = ? AND m.quarantined = 1")
          .c_str());
  row.bind(1, std::string_view(key.source)).bind(2, std::string_view(key.session)).bind(3, key.seq);
  if (!row.step()) return std::nullopt;
  JournalEntry entry = read_record(row).entry;
  if (entry.released) return entry;
  const std::string seal = release_seal(i.last_release_seal, i.releases + 1, entry.id);
  Statement insert(i.database, "INSERT INTO release VALUES(?,?,?)");
  insert.bind(1, i.releases + 1).bind(2, entry.id).bind_blob(3, seal);
  insert.run();
  i.last_release_seal = seal;
  ++i.releases;
  return entry;
}

std::int64_t Journal::count() const {
  return implementation_->count;
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
      select_records(implementation_->database, "WHERE m.quarantined = 1 AND r.id IS NULL ORDER BY m.id")
          .c_str());
  while (rows.step()) entries.push_back(read_record(rows).entry);
  return entries;
}

const std::string& Journal::path() const {
  return implementation_->path;
}

std::string Journal::seal() const {
  Digest digest{};
  if (implementation_->seal.size() == digest.size())
    std::copy(implementation_->seal.begin(), implementation_->seal.end(), digest.begin());
  return to_hex(digest);
}

}  // namespace knothe::service
