#pragma once
/// @file For tests: a file system under SQLite whose n-th write and all later ones fail, as on a full disk,
/// or whose n-th call of any kind does.
#include "knothe/service/testing/wrapped_files.hpp"

namespace knothe::service {

/// While it lives, SQLite's databases are opened through it. One at a time.
class FailingFiles : public WrappedFiles {
 public:
  FailingFiles() : WrappedFiles("failing", open) { state() = {}; }

  /// Write, sync or truncation number `n` from now on fails, and all after it; 0: none.
  void fail_from(int n) { state() = {0, n, false, false}; }
  /// Call number `n` from now on fails, of whatever kind, and that alone.
  void fail_once(int n) { state() = {0, n, true, false}; }
  [[nodiscard]] bool failed() const { return state().failed; }

 private:
  struct State {
    int count = 0, from = 0;
    bool once = false, failed = false;
  };
  static State& state() {
    static State k_state;
    return k_state;
  }
  static bool fails() {
    State& s = state();
    const bool now = s.from > 0 && ++s.count >= s.from && (!s.once || s.count == s.from);
    s.failed = s.failed || now;
    return now;
  }
  /// Of a call that only fails where any may.
  static bool reading_fails() { return state().once && fails(); }

  static int open(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out) {
    file->pMethods = nullptr;
    if (reading_fails()) return SQLITE_CANTOPEN;
    const int code = base()->xOpen(base(), name, real(file), flags, out);
    if (code == SQLITE_OK) file->pMethods = methods();
    return code;
  }
  static const sqlite3_io_methods* methods() {
    static const sqlite3_io_methods k_methods = [] {
      sqlite3_io_methods m = passed_on();
      m.xRead = [](sqlite3_file* f, void* b, int n, sqlite3_int64 at) {
        return reading_fails() ? SQLITE_IOERR_READ : real(f)->pMethods->xRead(real(f), b, n, at);
      };
      m.xWrite = [](sqlite3_file* f, const void* b, int n, sqlite3_int64 at) {
        return fails() ? SQLITE_FULL : real(f)->pMethods->xWrite(real(f), b, n, at);
      };
      m.xTruncate = [](sqlite3_file* f, sqlite3_int64 n) {
        return fails() ? SQLITE_IOERR_TRUNCATE : real(f)->pMethods->xTruncate(real(f), n);
      };
      m.xSync = [](sqlite3_file* f, int how) {
        return fails() ? SQLITE_IOERR_FSYNC : real(f)->pMethods->xSync(real(f), how);
      };
      m.xFileSize = [](sqlite3_file* f, sqlite3_int64* n) {
        return reading_fails() ? SQLITE_IOERR_FSTAT : real(f)->pMethods->xFileSize(real(f), n);
      };
      m.xShmMap = [](sqlite3_file* f, int p, int n, int e, void volatile** out) {
        return reading_fails() ? SQLITE_IOERR_SHMMAP : real(f)->pMethods->xShmMap(real(f), p, n, e, out);
      };
      return m;
    }();
    return &k_methods;
  }
};

}  // namespace knothe::service
