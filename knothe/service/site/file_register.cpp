#include "knothe/service/site/file_register.hpp"

#include <utility>

namespace knothe::service {

void FileRegister::restore(const std::vector<JournalFile>& files, std::set<likelihood::DatumKey> keys) {
  const std::lock_guard lock(mutex_);
  for (const JournalFile& file : files) add(file);
  keys_ = std::move(keys);
}

void FileRegister::add(const JournalFile& file) {
  last_digest_[{file.source, file.name}] = file.digest;
  if (file.outcome == FileOutcome::elsewhere) {
    elsewhere_.insert(file.digest);
    return;
  }
  const bool is_taken = file.outcome == FileOutcome::taken;
  (is_taken ? taken_ : refused_).emplace(file.source, file.name, file.digest);
  if (is_taken && file.seq >= 0) name_of_.try_emplace({file.source, file.seq}, file.name);
}

std::optional<FileOutcome> FileRegister::settled(const JournalFile& file) const {
  const std::lock_guard lock(mutex_);
  if (taken_.contains({file.source, file.name, file.digest})) return FileOutcome::taken;
  if (elsewhere_.contains(file.digest)) return FileOutcome::elsewhere;
  if (refused_.contains({file.source, file.name, file.digest})) return FileOutcome::refused;
  return std::nullopt;
}

std::string FileRegister::digest_of(const std::string& source, const std::string& name) const {
  const std::lock_guard lock(mutex_);
  const auto it = last_digest_.find({source, name});
  return it == last_digest_.end() ? "" : it->second;
}

std::optional<std::string> FileRegister::holder(const likelihood::DatumKey& key) const {
  const std::lock_guard lock(mutex_);
  if (!keys_.contains(key)) return std::nullopt;
  const auto it = name_of_.find({key.source, key.seq});
  return it == name_of_.end() ? "" : it->second;
}

void FileRegister::hold(const likelihood::DatumKey& key) {
  const std::lock_guard lock(mutex_);
  keys_.insert(key);
}

void FileRegister::hold(const JournalFile& file) {
  const std::lock_guard lock(mutex_);
  add(file);
}

void FileRegister::note(JournalFile file) {
  const std::lock_guard lock(mutex_);
  if (file.outcome == FileOutcome::refused && refused_.contains({file.source, file.name, file.digest}))
    return;
  add(file);
  unwritten_.push_back(std::move(file));
}

std::deque<JournalFile> FileRegister::take_unwritten() {
  const std::lock_guard lock(mutex_);
  return std::exchange(unwritten_, {});
}

void FileRegister::put_back(const std::deque<JournalFile>& files) {
  const std::lock_guard lock(mutex_);
  unwritten_.insert(unwritten_.begin(), files.begin(), files.end());
}

bool FileRegister::has_unwritten() const {
  const std::lock_guard lock(mutex_);
  return !unwritten_.empty();
}

}  // namespace knothe::service
