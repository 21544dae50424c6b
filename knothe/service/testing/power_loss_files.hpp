#pragma once
/// @file For tests: a file system under SQLite that loses power. What was not synced is then on disk in part:
/// any of the sectors written since, in whatever order, some of them torn.
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

#include "knothe/service/testing/wrapped_files.hpp"

namespace knothe::service {

/// While it lives, SQLite's databases are opened through it. One at a time; paths must be short-lived.
class PowerLossFiles : public WrappedFiles {
 public:
  PowerLossFiles() : WrappedFiles("power-loss", open, remove) { state() = {}; }

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
  static State& state() {
    static State k_state;
    return k_state;
  }
  static bool fails() {
    State& s = state();
    s.off = s.off || (s.from > 0 && ++s.count >= s.from);
    return s.off;
  }
  /// Null: a file that is no part of the database.
  static Disk* disk(sqlite3_file* file) { return static_cast<Disk*>(own(file)); }

  static int open(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out) {
    file->pMethods = nullptr;
    own(file) = nullptr;
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
    own(file) = &it->second;
    return code;
  }
  static int remove(sqlite3_vfs*, const char* name, int synced) {
    if (fails()) return SQLITE_IOERR_DELETE;
    if (const auto it = state().disks.find(name); it != state().disks.end()) it->second.is_removed = true;
    return base()->xDelete(base(), name, synced);
  }
  static const sqlite3_io_methods* methods() {
    static const sqlite3_io_methods k_methods = [] {
      sqlite3_io_methods m = passed_on();
      m.xWrite = [](sqlite3_file* f, const void* b, int n, sqlite3_int64 at) {
        if (disk(f) != nullptr && !state().off)  // the one at which the power goes may be there too
          disk(f)->pending.push_back(
              {static_cast<std::size_t>(at), {static_cast<const char*>(b), static_cast<std::size_t>(n)}});
        return fails() ? SQLITE_IOERR_WRITE : real(f)->pMethods->xWrite(real(f), b, n, at);
      };
      m.xTruncate = [](sqlite3_file* f, sqlite3_int64 n) {
        if (disk(f) != nullptr && !state().off)
          disk(f)->pending.push_back({static_cast<std::size_t>(n), "", true});
        return fails() ? SQLITE_IOERR_TRUNCATE : real(f)->pMethods->xTruncate(real(f), n);
      };
      m.xSync = [](sqlite3_file* f, int) {
        if (fails()) return SQLITE_IOERR_FSYNC;
        if (disk(f) != nullptr) disk(f)->sync();
        return SQLITE_OK;  // no real power is lost
      };
      return m;
    }();
    return &k_methods;
  }
};

}  // namespace knothe::service
