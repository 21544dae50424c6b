#pragma once
/// @file For tests: a file system under SQLite that loses power. What was not synced is then on disk in part:
/// any of the sectors written since, in whatever order, some of them torn.
#include <sqlite3.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace knothe::service {

/// While it lives, SQLite's databases are opened through it. One at a time; paths must be short-lived.
class PowerLossFiles {
 public:
  PowerLossFiles() {
    state() = {};
    base() = sqlite3_vfs_find(nullptr);
    vfs_ = *base();
    vfs_.zName = "power-loss";
    vfs_.pNext = nullptr;
    vfs_.szOsFile = static_cast<int>(sizeof(File)) + base()->szOsFile;
    vfs_.xOpen = open;
    vfs_.xDelete = remove;
    sqlite3_vfs_register(&vfs_, 1);
  }
  ~PowerLossFiles() {
    sqlite3_vfs_unregister(&vfs_);
    sqlite3_vfs_register(base(), 1);
  }
  PowerLossFiles(const PowerLossFiles&) = delete;
  PowerLossFiles& operator=(const PowerLossFiles&) = delete;

  /// The power goes at write, sync or truncation number `n` from now on: it and all after it fail.
  void lose_power_at(int n) { state().count = 0, state().from = n, state().off = false; }
  [[nodiscard]] bool is_off() const { return state().off; }
  /// Their folder is synced: what has a name keeps it, what was removed is gone.
  void sync_names() {
    std::erase_if(state().disks, [](const auto& disk) { return disk.second.is_removed; });
    for (auto& [path, disk] : state().disks) disk.exists = true;
  }
  /// After everybody has closed the files: what is on the disk when the power is back.
  void restore_power(unsigned seed) {
    std::mt19937 random(seed);
    for (const auto& [path, disk] : state().disks) {
      std::filesystem::remove(path);
      if ((!disk.exists || disk.is_removed) && random() % 2 == 0) continue;  // nor is its name
      const std::string left = disk.after_power_loss(random);
      std::ofstream(path, std::ios::binary).write(left.data(), static_cast<std::streamsize>(left.size()));
    }
    state() = {};
  }

 private:
  static constexpr std::size_t k_sector = 512;
  struct Write {
    std::size_t offset;
    std::string bytes;
    bool truncates = false;  ///< to `offset`
  };
  struct Disk {
    bool exists = false;      ///< its name is on disk
    bool is_removed = false;  ///< and may be so still
    std::string synced;
    std::vector<Write> pending;

    static void put(std::string& content, std::size_t offset, std::string_view bytes) {
      if (content.size() < offset + bytes.size()) content.resize(offset + bytes.size());
      content.replace(offset, bytes.size(), bytes);
    }
    void sync() {
      for (const Write& write : pending) {
        if (write.truncates) {
          synced.resize(write.offset);
        } else {
          put(synced, write.offset, write.bytes);
        }
      }
      pending.clear();
      exists = true;
    }
    [[nodiscard]] std::string after_power_loss(std::mt19937& random) const {
      std::string left = synced;
      const unsigned most = random() % 4;  // none, few, half, most of the sectors
      std::vector<Write> pieces;
      for (const Write& write : pending) {
        if (write.truncates) pieces.push_back(write);
        for (std::size_t at = 0; at < write.bytes.size();) {
          const std::size_t end = ((write.offset + at) / k_sector + 1) * k_sector - write.offset;
          const std::size_t size = std::min(end, write.bytes.size()) - at;
          pieces.push_back({write.offset + at, write.bytes.substr(at, size)});
          at += size;
        }
      }
      std::shuffle(pieces.begin(), pieces.end(), random);
      for (Write& piece : pieces) {
        if (random() % 4 >= most) continue;
        if (piece.truncates) {
          left.resize(std::min(left.size(), piece.offset));
          continue;
        }
        if (random() % 4 == 0) piece.bytes.resize(random() % (piece.bytes.size() + 1));  // torn
        put(left, piece.offset, piece.bytes);
      }
      return left;
    }
  };
  struct State {
    int count = 0, from = 0;
    bool off = false;
    std::map<std::string, Disk> disks;
  };
  struct File {
    sqlite3_file head;
    Disk* disk;  ///< null: a file that is no part of the database
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
    s.off = s.off || (s.from > 0 && ++s.count >= s.from);
    return s.off;
  }
  static Disk* disk(sqlite3_file* file) { return reinterpret_cast<File*>(file)->disk; }
  static sqlite3_file* real(sqlite3_file* file) { return reinterpret_cast<File*>(file)->real(); }

  static int open(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out) {
    file->pMethods = nullptr;
    reinterpret_cast<File*>(file)->disk = nullptr;
    const bool there = name != nullptr && std::filesystem::exists(name);
    const int code = base()->xOpen(base(), name, real(file), flags, out);
    if (code != SQLITE_OK) return code;
    file->pMethods = methods();
    if (name == nullptr) return code;
    const auto [it, is_new] = state().disks.try_emplace(name);
    if (std::exchange(it->second.is_removed, false)) it->second = {};
    if (is_new && there) {
      std::ifstream content(name, std::ios::binary);
      it->second.synced.assign(std::istreambuf_iterator<char>(content), {});
      it->second.exists = true;
    }
    reinterpret_cast<File*>(file)->disk = &it->second;
    return code;
  }
  static int remove(sqlite3_vfs*, const char* name, int synced) {
    if (fails()) return SQLITE_IOERR_DELETE;
    if (const auto it = state().disks.find(name); it != state().disks.end()) it->second.is_removed = true;
    return base()->xDelete(base(), name, synced);
  }
  static const sqlite3_io_methods* methods() {
    static const sqlite3_io_methods k_methods = {
        2,
        [](sqlite3_file* f) { return real(f)->pMethods->xClose(real(f)); },
        [](sqlite3_file* f, void* b, int n, sqlite3_int64 at) {
          return real(f)->pMethods->xRead(real(f), b, n, at);
        },
        [](sqlite3_file* f, const void* b, int n, sqlite3_int64 at) {
          if (disk(f) != nullptr && !state().off)  // the one at which the power goes may be there too
            disk(f)->pending.push_back(
                {static_cast<std::size_t>(at), {static_cast<const char*>(b), static_cast<std::size_t>(n)}});
          return fails() ? SQLITE_IOERR_WRITE : real(f)->pMethods->xWrite(real(f), b, n, at);
        },
        [](sqlite3_file* f, sqlite3_int64 n) {
          if (disk(f) != nullptr && !state().off)
            disk(f)->pending.push_back({static_cast<std::size_t>(n), "", true});
          return fails() ? SQLITE_IOERR_TRUNCATE : real(f)->pMethods->xTruncate(real(f), n);
        },
        [](sqlite3_file* f, int) {
          if (fails()) return SQLITE_IOERR_FSYNC;
          if (disk(f) != nullptr) disk(f)->sync();
          return SQLITE_OK;  // no real power is lost
        },
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
    return &k_methods;
  }

  sqlite3_vfs vfs_{};
};

}  // namespace knothe::service
