#pragma once
/// @file The journal's records as they are on disk, and their seals. Private to the room.
#include <string>
#include <string_view>

#include "knothe/service/journal/journal.hpp"
#include "knothe/service/journal/sqlite.hpp"

namespace knothe::service {

/// What `read_record` reads: SELECT … FROM … (WHERE and ORDER BY are to be added).
inline constexpr const char* k_record_columns =
    "SELECT m.id, m.source, m.session, m.seq, m.time, m.step, m.payload, m.quarantined, m.received, m.seal, "
    "r.id "
    "FROM measurement m LEFT JOIN release r ON r.measurement = m.id ";

struct Record {
  JournalEntry entry;
  std::string payload;
  std::string seal;
  bool well_formed = false;
};

[[nodiscard]] Record read_record(const Statement& row);
/// SHA-256(seal before ‖ record), raw bytes.
[[nodiscard]] std::string seal_of(std::string_view previous, const Record& record);
[[nodiscard]] std::string release_seal(std::string_view previous, std::int64_t id, std::int64_t measurement);
/// The first column of the first row; 0 without one.
[[nodiscard]] std::int64_t one_integer(Database& database, const char* sql);

}  // namespace knothe::service
