#include "knothe/service/journal/journal_schema.hpp"

#include <fmt/format.h>

#include <array>

#include "knothe/base/error.hpp"
#include "knothe/service/journal/journal_records.hpp"

namespace knothe::service {
namespace {

constexpr std::int64_t k_application = 0x6b6e6f74;  // "knot"

/// From an empty file to schema 1.
constexpr const char* k_to_schema_1 = R"(
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

/// A measurement's own noise. A journal of schema 1 that is only read stays as it is.
constexpr const char* k_to_schema_2 = R"(
  ALTER TABLE measurement ADD COLUMN noise BLOB;
  PRAGMA user_version = 2;
)";

/// Withdrawals. A key may come again after one, so it is no longer unique, which SQLite can only say of a new
/// table; `verify` sees to it that at most one record of a key is not withdrawn.
constexpr const char* k_to_schema_3 = R"(
  CREATE TABLE record(id INTEGER PRIMARY KEY, source TEXT NOT NULL, session TEXT NOT NULL,
                      seq INTEGER NOT NULL, time REAL NOT NULL, step INTEGER NOT NULL,
                      payload BLOB NOT NULL, quarantined INTEGER NOT NULL, received INTEGER NOT NULL,
                      seal BLOB NOT NULL, noise BLOB);
  INSERT INTO record SELECT id, source, session, seq, time, step, payload, quarantined, received, seal, noise
                     FROM measurement ORDER BY id;
  DROP TABLE measurement;
  ALTER TABLE record RENAME TO measurement;
  CREATE INDEX measurement_key ON measurement(source, session, seq);
  CREATE TABLE withdrawal(id INTEGER PRIMARY KEY, measurement INTEGER NOT NULL UNIQUE, seal BLOB NOT NULL);
  PRAGMA user_version = 3;
)";

/// Alarms, and a number that no other journal has.
constexpr const char* k_to_schema_4 = R"(
  CREATE TABLE alarm(id INTEGER PRIMARY KEY, event INTEGER NOT NULL, step INTEGER NOT NULL, severity TEXT NOT NULL,
                     kind TEXT NOT NULL, message TEXT NOT NULL, condition TEXT NOT NULL, raised INTEGER NOT NULL,
                     seal BLOB NOT NULL);
  CREATE INDEX alarm_condition ON alarm(condition, id);
  INSERT INTO meta VALUES('journal', random() & 0x7fffffffffffffff);
  PRAGMA user_version = 4;
)";

/// The logbook.
constexpr const char* k_to_schema_5 = R"(
  CREATE TABLE logbook(id INTEGER PRIMARY KEY, kind TEXT NOT NULL, subject INTEGER NOT NULL, time REAL NOT NULL,
                       author TEXT NOT NULL, text TEXT NOT NULL, written INTEGER NOT NULL, seal BLOB NOT NULL);
  PRAGMA user_version = 5;
)";

/// The files of watched folders.
constexpr const char* k_to_schema_6 = R"(
  CREATE TABLE file(id INTEGER PRIMARY KEY, source TEXT NOT NULL, name TEXT NOT NULL, digest TEXT NOT NULL,
                    outcome TEXT NOT NULL, seq INTEGER NOT NULL, seal BLOB NOT NULL);
  PRAGMA user_version = 6;
)";

constexpr std::array k_migrations = {k_to_schema_1, k_to_schema_2, k_to_schema_3,
                                     k_to_schema_4, k_to_schema_5, k_to_schema_6};

}  // namespace

std::int64_t schema_of(Database& database) {
  return one_integer(database, "PRAGMA user_version");
}

bool is_empty(Database& database) {
  return schema_of(database) == 0 && one_integer(database, "SELECT count(*) FROM sqlite_master") == 0;
}

void check_schema(Database& database) {
  const std::string& path = database.path();
  if (one_integer(database, "PRAGMA application_id") != k_application)
    throw DataError(fmt::format("{}: is a database, but not a journal of knothe", path));
  const std::int64_t schema = schema_of(database);
  if (schema > std::ssize(k_migrations))
    throw DataError(fmt::format("{}: journal of schema {}, this knothe knows up to {}: use a newer knothe",
                                path, schema, k_migrations.size()));
  if (schema < 1) throw DataError(fmt::format("{}: journal of unknown schema {}", path, schema));
}

void migrate(Database& database) {
  const std::size_t from = schema_of(database);
  if (from >= k_migrations.size()) return;
  database.execute("BEGIN IMMEDIATE");
  for (std::size_t k = from; k < k_migrations.size(); ++k) database.execute(k_migrations[k]);
  database.execute("COMMIT");
}

}  // namespace knothe::service
