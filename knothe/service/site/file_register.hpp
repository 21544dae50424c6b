#pragma once
/// @file What became of each file of the watched folders: the journal's table `file`, in memory.
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <tuple>

#include "knothe/likelihood/data/datum.hpp"
#include "knothe/service/journal/journal_file.hpp"

namespace knothe::service {

/// A file is its content, whatever it is called and whenever it came. Thread-safe; its mutex is taken last.
class FileRegister {
 public:
  /// What the journal holds.
  void restore(const std::vector<JournalFile>& files, std::set<likelihood::DatumKey> keys);

  /// Whether the file is done with: its data are in the journal, or it was there before the test was begun.
  /// One that was refused may be tried again.
  [[nodiscard]] std::optional<FileOutcome> settled(const JournalFile& file) const;
  /// The digest that a file of this name had when it was looked at last; empty: it never was.
  [[nodiscard]] std::string digest_of(const std::string& source, const std::string& name) const;
  /// The file that a datum of this key came from, which may be withdrawn by now; empty: one that is not
  /// known; nothing: there is no such datum.
  [[nodiscard]] std::optional<std::string> holder(const likelihood::DatumKey& key) const;

  /// A datum of a watched folder is on disk; with it, where it is a picture, what is noted of its file.
  void hold(const likelihood::DatumKey& key);
  void hold(const JournalFile& file);
  /// What became of a file. It is on disk with the next group.
  void note(JournalFile file);
  /// What is not on disk yet, and is to be written now; `put_back`: it could not be.
  [[nodiscard]] std::deque<JournalFile> take_unwritten();
  void put_back(const std::deque<JournalFile>& files);
  [[nodiscard]] bool has_unwritten() const;

 private:
  void add(const JournalFile& file);

  mutable std::mutex mutex_;
  std::set<std::tuple<std::string, std::string, std::string>> taken_, refused_;  ///< source, name, digest
  std::set<std::string> elsewhere_;                                              ///< digests
  std::map<std::pair<std::string, std::string>, std::string> last_digest_;       ///< by source and name
  std::map<std::pair<std::string, std::int64_t>, std::string> name_of_;          ///< by source and seq
  std::set<likelihood::DatumKey> keys_;
  std::deque<JournalFile> unwritten_;
};

}  // namespace knothe::service
