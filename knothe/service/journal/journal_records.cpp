#include "knothe/service/journal/journal_records.hpp"

#include "knothe/base/sha256.hpp"

namespace knothe::service {

Record read_record(const Statement& row) {
  Record record;
  JournalEntry& e = record.entry;
  e.id = row.integer(0);
  e.datum.key = {std::string(row.text(1)), std::string(row.text(2)), row.integer(3)};
  e.datum.time = row.number(4);
  e.datum.step = row.integer(5);
  record.payload = row.text(6);
  e.quarantined = row.integer(7) != 0;
  e.datum.received_ms = row.integer(8);
  record.seal = row.text(9);
  e.released = !row.is_null(10);
  record.well_formed = e.datum.set_payload(record.payload) && record.seal.size() == sizeof(Digest);
  return record;
}

std::string seal_of(std::string_view previous, const Record& record) {
  Sha256 sum;
  sum.add_text(previous);
  const Datum& d = record.entry.datum;
  sum.add_number(record.entry.id);
  sum.add_text(d.key.source);
  sum.add_text(d.key.session);
  sum.add_number(d.key.seq);
  sum.add_number(d.time);
  sum.add_number(d.step);
  sum.add_text(record.payload);
  sum.add_number(static_cast<std::int64_t>(record.entry.quarantined));
  sum.add_number(d.received_ms);
  const Digest digest = sum.finish();
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

std::string release_seal(std::string_view previous, std::int64_t id, std::int64_t measurement) {
  Sha256 sum;
  sum.add_text(previous);
  sum.add_number(id);
  sum.add_number(measurement);
  const Digest digest = sum.finish();
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

std::int64_t one_integer(Database& database, const char* sql) {
  Statement statement(database, sql);
  return statement.step() ? statement.integer(0) : 0;
}

}  // namespace knothe::service
