#include "knothe/service/journal/journal_records.hpp"

#include <fmt/format.h>

#include "knothe/base/sha256.hpp"
#include "knothe/service/journal/journal_schema.hpp"

namespace knothe::service {

std::string select_records(Database& database, const char* condition) {
  const std::int64_t schema = schema_of(database);
  return fmt::format(
      "SELECT m.id, m.source, m.session, m.seq, m.time, m.step, m.payload, m.quarantined, m.received, "
      "m.seal, r.id, {}, {} FROM measurement m LEFT JOIN release r ON r.measurement = m.id {} {}",
      schema < 2 ? "NULL" : "m.noise", schema < 3 ? "NULL" : "w.id",
      schema < 3 ? "" : "LEFT JOIN withdrawal w ON w.measurement = m.id", condition);
}

Record read_record(const Statement& row) {
  Record record;
  JournalEntry& e = record.entry;
  e.id = row.integer(0);
  e.measurement.key = {std::string(row.text(1)), std::string(row.text(2)), row.integer(3)};
  e.measurement.time = row.number(4);
  e.measurement.step = row.integer(5);
  record.payload = row.text(6);
  const std::int64_t quarantine = row.integer(7);
  e.quarantined = Quarantine::of_code(quarantine);
  e.measurement.received_ms = row.integer(8);
  record.seal = row.text(9);
  e.released = !row.is_null(10);
  if (!row.is_null(11)) e.measurement.noise = row.text(11);
  e.withdrawn = !row.is_null(12);
  record.well_formed = e.measurement.set_payload(record.payload) && record.seal.size() == sizeof(Digest) &&
                       quarantine == e.quarantined.code();
  return record;
}

std::string seal_of(std::string_view previous, const Record& record) {
  Sha256 sum;
  sum.add_text(previous);
  const Measurement& d = record.entry.measurement;
  sum.add_number(record.entry.id);
  sum.add_text(d.key.source);
  sum.add_text(d.key.session);
  sum.add_number(d.key.seq);
  sum.add_number(d.time);
  sum.add_number(d.step);
  sum.add_text(record.payload);
  sum.add_number(record.entry.quarantined.code());
  sum.add_number(d.received_ms);
  if (!d.noise.empty()) sum.add_text(d.noise);
  const Digest digest = sum.finish();
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

std::string mark_seal(std::string_view previous, std::int64_t id, std::int64_t measurement) {
  Sha256 sum;
  sum.add_text(previous);
  sum.add_number(id);
  sum.add_number(measurement);
  const Digest digest = sum.finish();
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

std::string alarm_seal(std::string_view previous, std::int64_t id, const Alarm& alarm) {
  Sha256 sum;
  sum.add_text(previous);
  sum.add_number(id);
  sum.add_number(alarm.id);
  sum.add_number(alarm.step);
  for (const std::string* text : {&alarm.severity, &alarm.kind, &alarm.message, &alarm.condition})
    sum.add_text(*text);
  sum.add_number(alarm.raised_ms);
  const Digest digest = sum.finish();
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

Alarm read_alarm(const Statement& row, int first) {
  const auto text = [&](int k) { return std::string(row.text(first + k)); };
  return {
      row.integer(first), row.integer(first + 1), text(2), text(3), text(4), text(5), row.integer(first + 6),
      std::nullopt};
}

std::string entry_seal(std::string_view previous, const LogbookEntry& entry) {
  Sha256 sum;
  sum.add_text(previous);
  sum.add_number(entry.number);
  sum.add_text(to_text(entry.kind));
  sum.add_number(entry.subject);
  sum.add_number(entry.time);
  sum.add_text(entry.author);
  sum.add_text(entry.text);
  sum.add_number(entry.written_ms);
  const Digest digest = sum.finish();
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

bool visit_logbook(Database& database,
                   const std::function<bool(const LogbookEntry&, const std::string& seal)>& visit) {
  if (schema_of(database) < 5) return true;
  Statement rows(database,
                 "SELECT id, kind, subject, time, author, text, written, seal FROM logbook ORDER BY id");
  while (rows.step()) {
    const auto kind = from_text<EntryKind>(rows.text(1));
    const auto words = [&](int k) { return std::string(rows.text(k)); };
    const LogbookEntry entry{
        rows.integer(0), kind.value_or(EntryKind::note), rows.integer(2), rows.number(3), words(4), words(5),
        rows.integer(6)};
    if (!visit(entry, kind ? words(7) : std::string())) return false;
  }
  return true;
}

std::string file_seal(std::string_view previous, std::int64_t number, const JournalFile& file) {
  Sha256 sum;
  sum.add_text(previous);
  sum.add_number(number);
  for (const std::string& text : {file.source, file.name, file.digest, std::string(to_text(file.outcome))})
    sum.add_text(text);
  sum.add_number(file.seq);
  const Digest digest = sum.finish();
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

bool visit_files(
    Database& database,
    const std::function<bool(std::int64_t number, const JournalFile&, const std::string& seal)>& visit) {
  if (schema_of(database) < 6) return true;
  Statement rows(database, "SELECT id, source, name, digest, outcome, seq, seal FROM file ORDER BY id");
  while (rows.step()) {
    const auto outcome = from_text<FileOutcome>(rows.text(4));
    const auto words = [&](int k) { return std::string(rows.text(k)); };
    const JournalFile file{words(1), words(2), words(3), outcome.value_or(FileOutcome::refused),
                           rows.integer(5)};
    if (!visit(rows.integer(0), file, outcome ? words(6) : std::string())) return false;
  }
  return true;
}

std::int64_t one_integer(Database& database, const char* sql) {
  Statement statement(database, sql);
  return statement.step() ? statement.integer(0) : 0;
}

}  // namespace knothe::service
