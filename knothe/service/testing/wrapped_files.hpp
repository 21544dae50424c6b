#pragma once
/// @file For tests: a file system under SQLite that passes all calls on to the real one, but for those that a
/// class made of it takes over.
#include <sqlite3.h>

namespace knothe::service {

/// While it lives, SQLite's databases are opened through it. One at a time.
class WrappedFiles {
 public:
  WrappedFiles(const WrappedFiles&) = delete;
  WrappedFiles& operator=(const WrappedFiles&) = delete;

 protected:
  using Open = int (*)(sqlite3_vfs*, const char*, sqlite3_file*, int, int*);
  using Remove = int (*)(sqlite3_vfs*, const char*, int);

  /// `remove`: null for the real one.
  WrappedFiles(const char* name, Open open, Remove remove = nullptr) {
    base() = sqlite3_vfs_find(nullptr);
    vfs_ = *base();
    vfs_.zName = name;
    vfs_.pNext = nullptr;
    vfs_.szOsFile = static_cast<int>(sizeof(File)) + base()->szOsFile;
    vfs_.xOpen = open;
    if (remove != nullptr) vfs_.xDelete = remove;
    sqlite3_vfs_register(&vfs_, 1);
  }
  ~WrappedFiles() {
    sqlite3_vfs_unregister(&vfs_);
    sqlite3_vfs_register(base(), 1);
  }

  static sqlite3_vfs*& base() {
    static sqlite3_vfs* k_base = nullptr;
    return k_base;
  }
  static sqlite3_file* real(sqlite3_file* file) {
    return reinterpret_cast<sqlite3_file*>(reinterpret_cast<File*>(file) + 1);
  }
  /// What the class that takes calls over knows of a file.
  static void*& own(sqlite3_file* file) { return reinterpret_cast<File*>(file)->own; }

  static sqlite3_io_methods passed_on() {
    return {2,
            [](sqlite3_file* f) { return real(f)->pMethods->xClose(real(f)); },
            [](sqlite3_file* f, void* b, int n, sqlite3_int64 at) {
              return real(f)->pMethods->xRead(real(f), b, n, at);
            },
            [](sqlite3_file* f, const void* b, int n, sqlite3_int64 at) {
              return real(f)->pMethods->xWrite(real(f), b, n, at);
            },
            [](sqlite3_file* f, sqlite3_int64 n) { return real(f)->pMethods->xTruncate(real(f), n); },
            [](sqlite3_file* f, int how) { return real(f)->pMethods->xSync(real(f), how); },
            [](sqlite3_file* f, sqlite3_int64* n) { return real(f)->pMethods->xFileSize(real(f), n); },
            [](sqlite3_file* f, int l) { return real(f)->pMethods->xLock(real(f), l); },
            [](sqlite3_file* f, int l) { return real(f)->pMethods->xUnlock(real(f), l); },
            [](sqlite3_file* f, int* l) { return real(f)->pMethods->xCheckReservedLock(real(f), l); },
            [](sqlite3_file* f, int op, void* a) { return real(f)->pMethods->xFileControl(real(f), op, a); },
            [](sqlite3_file* f) { return real(f)->pMethods->xSectorSize(real(f)); },
            [](sqlite3_file* f) { return real(f)->pMethods->xDeviceCharacteristics(real(f)); },
            [](sqlite3_file* f, int p, int n, int e, void volatile** out) {
              return real(f)->pMethods->xShmMap(real(f), p, n, e, out);
            },
            [](sqlite3_file* f, int o, int n, int flags) {
              return real(f)->pMethods->xShmLock(real(f), o, n, flags);
            },
            [](sqlite3_file* f) { real(f)->pMethods->xShmBarrier(real(f)); },
            [](sqlite3_file* f, int d) { return real(f)->pMethods->xShmUnmap(real(f), d); },
            nullptr,
            nullptr};
  }

 private:
  struct File {
    sqlite3_file head;
    void* own;
  };
  sqlite3_vfs vfs_{};
};

}  // namespace knothe::service
