#include <fcntl.h>
#include <fmt/format.h>
#include <sqlite3.h>
#include <unistd.h>

#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/service/journal/journal.hpp"
#include "knothe/service/journal/journal_records.hpp"
#include "knothe/service/journal/journal_schema.hpp"
#include "knothe/service/journal/sqlite.hpp"
#include "knothe/service/journal/verification.hpp"

namespace knothe::service {
namespace {

/// All pages as they are at one moment: a writer is not held up, and what it writes meanwhile is not in it.
void copy_pages(const std::string& from, const std::string& to) {
  ::close(::open(to.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));  // nobody else's business
  Database source(from, Database::Mode::read_only), copy(to, Database::Mode::create);
  sqlite3_backup* backup = sqlite3_backup_init(copy.handle(), "main", source.handle(), "main");
  if (backup == nullptr) copy.check(sqlite3_errcode(copy.handle()));
  (void)sqlite3_backup_step(backup, -1);
  copy.check(sqlite3_backup_finish(backup));
  copy.execute("DELETE FROM meta WHERE key = 'marked'");  // it has no mark beside it
  copy.execute("PRAGMA journal_mode = DELETE");           // one file, without a log beside it
}

}  // namespace

JournalGlance glance_at_journal(const std::string& path) {
  Database database(path, Database::Mode::read_only);
  JournalGlance glance;
  if (is_empty(database)) return glance;  // who began it died before it was one
  check_schema(database);
  glance.records = one_integer(database, "SELECT count(*) FROM measurement");
  glance.is_used = glance.records > 0;
  TestCourse course;
  visit_logbook(database, [&](const LogbookEntry& entry, const std::string&) {
    course.add(entry);
    glance.is_used = glance.is_used || entry.kind != EntryKind::test_begun;
    return true;
  });
  glance.finished = course.end().has_value();
  glance.followed_by = course.followed_by();
  glance.begun_ms = course.begun_ms();
  return glance;
}

std::string backup_journal(const std::string& from, const std::string& to) {
  if (!std::filesystem::exists(from)) throw DataError(fmt::format("{}: there is no such journal", from));
  if (std::filesystem::exists(to)) throw UsageError(fmt::format("{}: is there already; give a new name", to));
  require_no_refinement(from, to);
  std::string said;
  files::write_atomically(to, [&](const std::string& temporary) {
    copy_pages(from, temporary);
    const JournalReader copy(temporary);  // verifies every seal
    said = fmt::format("{} records, whole; seal {}", copy.count(), copy.seal());
  });
  copy_refinement(from, to);  // after the journal: a model is on disk before its entry is
  return said;
}

}  // namespace knothe::service
