#include "knothe/service/journal/sqlite.hpp"

#include <fmt/format.h>
#include <sqlite3.h>

namespace knothe::service {

Statement::Statement(Database& database, const char* sql) : database_(&database) {
  sqlite3_stmt* raw = nullptr;
  database.check(sqlite3_prepare_v2(database.handle(), sql, -1, &raw, nullptr));
  statement_.reset(raw, sqlite3_finalize);
}

Statement& Statement::bind(int place, std::int64_t value) {
  database_->check(sqlite3_bind_int64(statement_.get(), place, value));
  return *this;
}
Statement& Statement::bind(int place, double value) {
  database_->check(sqlite3_bind_double(statement_.get(), place, value));
  return *this;
}
Statement& Statement::bind(int place, std::string_view text) {
  database_->check(
      sqlite3_bind_text64(statement_.get(), place, text.data(), text.size(), SQLITE_TRANSIENT, SQLITE_UTF8));
  return *this;
}
Statement& Statement::bind_blob(int place, std::string_view bytes) {
  database_->check(
      sqlite3_bind_blob64(statement_.get(), place, bytes.data(), bytes.size(), SQLITE_TRANSIENT));
  return *this;
}

Statement& Statement::bind_null(int place) {
  database_->check(sqlite3_bind_null(statement_.get(), place));
  return *this;
}

bool Statement::step() {
  const int code = sqlite3_step(statement_.get());
  if (code == SQLITE_ROW) return true;
  if (code != SQLITE_DONE) {
    sqlite3_reset(statement_.get());
    database_->check(code);
  }
  return false;
}

void Statement::run() {
  while (step()) {
  }
  reset();
}

void Statement::reset() {
  sqlite3_reset(statement_.get());
}

std::int64_t Statement::integer(int column) const {
  return sqlite3_column_int64(statement_.get(), column);
}
double Statement::number(int column) const {
  return sqlite3_column_double(statement_.get(), column);
}
std::string_view Statement::text(int column) const {
  const auto* bytes = static_cast<const char*>(sqlite3_column_blob(statement_.get(), column));
  const std::size_t size = sqlite3_column_bytes(statement_.get(), column);
  return bytes == nullptr ? std::string_view() : std::string_view(bytes, size);
}
bool Statement::is_null(int column) const {
  return sqlite3_column_type(statement_.get(), column) == SQLITE_NULL;
}

Database::Database(const std::string& path, Mode mode) : path_(path) {
  const int flags = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE |
                    (mode == Mode::read_only    ? SQLITE_OPEN_READONLY
                     : mode == Mode::read_write ? SQLITE_OPEN_READWRITE
                                                : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
  sqlite3* raw = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &raw, flags, nullptr);
  handle_.reset(raw, sqlite3_close_v2);
  check(code);
  sqlite3_busy_timeout(raw, k_busy_timeout_ms);
}

void Database::execute(const char* sql) {
  check(sqlite3_exec(handle_.get(), sql, nullptr, nullptr, nullptr));
}

void Database::check(int code) {
  const int kind = code & 0xff;
  if (code == SQLITE_OK || kind == SQLITE_ROW || kind == SQLITE_DONE) return;
  const std::string words = handle_ ? sqlite3_errmsg(handle_.get()) : sqlite3_errstr(code);
  switch (kind) {
    case SQLITE_FULL:
    case SQLITE_IOERR:
    case SQLITE_READONLY:
      throw DiskFullError(fmt::format("{}: cannot be written: {}", path_, words));
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
    case SQLITE_FORMAT:
    case SQLITE_SCHEMA:
    case SQLITE_ERROR:  // a table or column that is not there
    case SQLITE_MISMATCH:
    case SQLITE_TOOBIG:
      throw DataError(
          fmt::format("{}: is not a whole journal: {}; `knothe recover {} -o NEW` saves what can be read",
                      path_, words, path_));
    case SQLITE_CANTOPEN:
      throw DataError(fmt::format("{}: the journal cannot be opened: {}", path_, words));
    case SQLITE_NOMEM:
      throw std::bad_alloc();
    default:
      throw IoError(fmt::format("{}: {}", path_, words));
  }
}

}  // namespace knothe::service
