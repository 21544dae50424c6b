#pragma once
/// @file For tests: a file system under SQLite whose n-th write and all later ones fail, as on a full disk,
/// or whose n-th call of any kind does.
#include <sqlite3.h>

#include <cstring>

namespace knothe::service {

/// While it lives, SQLite's databases are opened through it. One at a time.
class FailingFiles {
 public:
  FailingFiles() {
    state() = {};
    base() = sqlite3_vfs_find(nullptr);
    vfs_ = *base();
    vfs_.zName = "failing";
    vfs_.pNext = nullptr;
    vfs_.szOsFile = static_cast<int>(sizeof(File)) + base()->szOsFile;
    vfs_.xOpen = open;
    sqlite3_vfs_register(&vfs_, 1);
  }
  ~FailingFiles() {
    sqlite3_vfs_unregister(&vfs_);
    sqlite3_vfs_register(base(), 1);
  }
  FailingFiles(const FailingFiles&) = delete;
  FailingFiles& operator=(const FailingFiles&) = delete;

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
  struct File {
    sqlite3_file head;
    sqlite3_file* real() { return reinterpret_cast<sqlite3_file*>(this + 1); }
  };
  static State& state() {
    static State k_state;
    return k_state;
  }
  static sqlite3_vfs*& base() {
    static sqlite3_vfs* k_base = nullptr;
    return k_base;
  }
  static bool fails() {
    State& s = state();
    const bool now = s.from > 0 && ++s.count >= s.from && (!s.once || s.count == s.from);
    s.failed = s.failed || now;
    return now;
  }
  /// Of a call that only fails where any may.
  static bool reading_fails() { return state().once && fails(); }
  static sqlite3_file* real(sqlite3_file* file) { return reinterpret_cast<File*>(file)->real(); }

  static int open(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out) {
    file->pMethods = nullptr;
    if (reading_fails()) return SQLITE_CANTOPEN;
    const int code = base()->xOpen(base(), name, real(file), flags, out);
    if (code == SQLITE_OK) file->pMethods = methods();
    return code;
  }
  static const sqlite3_io_methods* methods() {
    static const sqlite3_io_methods k_methods = {
        2,
        [](sqlite3_file* f) { return real(f)->pMethods->xClose(real(f)); },
        [](sqlite3_file* f, void* b, int n, sqlite3_int64 at) {
          return reading_fails() ? SQLITE_IOERR_READ : real(f)->pMethods->xRead(real(f), b, n, at);
        },
        [](sqlite3_file* f, const void* b, int n, sqlite3_int64 at) {
          return fails() ? SQLITE_FULL : real(f)->pMethods->xWrite(real(f), b, n, at);
        },
        [](sqlite3_file* f, sqlite3_int64 n) {
          return fails() ? SQLITE_IOERR_TRUNCATE : real(f)->pMethods->xTruncate(real(f), n);
        },
        [](sqlite3_file* f, int how) {
          return fails() ? SQLITE_IOERR_FSYNC : real(f)->pMethods->xSync(real(f), how);
        },
        [](sqlite3_file* f, sqlite3_int64* n) {
          return reading_fails() ? SQLITE_IOERR_FSTAT : real(f)->pMethods->xFileSize(real(f), n);
        },
        [](sqlite3_file* f, int l) { return real(f)->pMethods->xLock(real(f), l); },
        [](sqlite3_file* f, int l) { return real(f)->pMethods->xUnlock(real(f), l); },
        [](sqlite3_file* f, int* l) { return real(f)->pMethods->xCheckReservedLock(real(f), l); },
        [](sqlite3_file* f, int op, void* a) { return real(f)->pMethods->xFileControl(real(f), op, a); },
        [](sqlite3_file* f) { return real(f)->pMethods->xSectorSize(real(f)); },
        [](sqlite3_file* f) { return real(f)->pMethods->xDeviceCharacteristics(real(f)); },
        [](sqlite3_file* f, int p, int n, int e, void volatile** out) {
          return reading_fails() ? SQLITE_IOERR_SHMMAP : real(f)->pMethods->xShmMap(real(f), p, n, e, out);
        },
        [](sqlite3_file* f, int o, int n, int flags) {
          return real(f)->pMethods->xShmLock(real(f), o, n, flags);
        },
        [](sqlite3_file* f) { real(f)->pMethods->xShmBarrier(real(f)); },
        [](sqlite3_file* f, int d) { return real(f)->pMethods->xShmUnmap(real(f), d); },
        nullptr,
        nullptr};
    return &k_methods;
  }

  sqlite3_vfs vfs_{};
};

}  // namespace knothe::service
