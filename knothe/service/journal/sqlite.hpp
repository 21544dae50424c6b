#pragma once
/// @file SQLite with its return values checked. Private to this room.
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "knothe/base/error.hpp"

struct sqlite3;
struct sqlite3_stmt;

namespace knothe::service {

/// How long a statement waits for what another connection does.
inline constexpr int k_busy_timeout_ms = 5000;

/// The disk is full, or cannot be written: what was being written is not there, and may be tried again.
struct DiskFullError : IoError {
  using IoError::IoError;
};

class Database;

/// A prepared statement. `bind` from 1, `column` from 0, as SQLite counts.
class Statement {
 public:
  Statement(Database& database, const char* sql);
  Statement& bind(int place, std::int64_t value);
  Statement& bind(int place, double value);
  Statement& bind(int place, std::string_view text);
  Statement& bind_blob(int place, std::string_view bytes);
  Statement& bind_null(int place);
  /// Whether there is a row.
  [[nodiscard]] bool step();
  /// For statements without rows.
  void run();
  void reset();
  [[nodiscard]] std::int64_t integer(int column) const;
  [[nodiscard]] double number(int column) const;
  [[nodiscard]] std::string_view text(int column) const;  ///< or blob; until the next step
  [[nodiscard]] bool is_null(int column) const;

 private:
  Database* database_;
  std::shared_ptr<sqlite3_stmt> statement_;
};

/// An open database. Use from one thread at a time.
class Database {
 public:
  enum class Mode { read_only, read_write, create };
  /// DataError where it cannot be opened or is no database.
  Database(const std::string& path, Mode mode);
  void execute(const char* sql);
  [[nodiscard]] const std::string& path() const { return path_; }
  /// Throws for a result code that is not success: DiskFullError, IoError, or DataError for damage.
  void check(int code);
  [[nodiscard]] sqlite3* handle() const { return handle_.get(); }

 private:
  std::string path_;
  std::shared_ptr<sqlite3> handle_;
};

}  // namespace knothe::service
