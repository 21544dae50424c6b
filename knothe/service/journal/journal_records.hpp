#pragma once
/// @file The journal's records as they are on disk, and their seals. Private to the room.
#include <functional>
#include <string>
#include <string_view>

#include "knothe/service/journal/journal.hpp"
#include "knothe/service/journal/sqlite.hpp"

namespace knothe::service {

/// What `read_record` reads, of a journal of any schema: SELECT … FROM … and then `condition`, WHERE or ORDER
/// BY.
[[nodiscard]] std::string select_records(Database& database, const char* condition);

struct Record {
  JournalEntry entry;
  std::string payload;
  std::string seal;
  bool well_formed = false;
};

[[nodiscard]] Record read_record(const Statement& row);
/// SHA-256(seal before ‖ record), raw bytes.
[[nodiscard]] std::string seal_of(std::string_view previous, const Record& record);
/// Of a release or a withdrawal.
[[nodiscard]] std::string mark_seal(std::string_view previous, std::int64_t id, std::int64_t measurement);
/// Of an alarm, number `id` of the journal's.
[[nodiscard]] std::string alarm_seal(std::string_view previous, std::int64_t id, const Alarm& alarm);
/// An alarm from the columns event, step, severity, kind, message, condition, raised, which begin at `first`.
[[nodiscard]] Alarm read_alarm(const Statement& row, int first);
/// Of an entry of the logbook.
[[nodiscard]] std::string entry_seal(std::string_view previous, const LogbookEntry& entry);
/// Calls `visit` for the logbook's entries and their seals, in order, until it says no: whether it never did.
/// There are none before schema 5. An entry of an unknown kind has an empty seal: nobody has written it.
bool visit_logbook(Database& database,
                   const std::function<bool(const LogbookEntry&, const std::string& seal)>& visit);
/// Of a file.
[[nodiscard]] std::string file_seal(std::string_view previous, std::int64_t number, const JournalFile& file);
/// As `visit_logbook`, for files and their numbers. There are none before schema 6.
bool visit_files(
    Database& database,
    const std::function<bool(std::int64_t number, const JournalFile&, const std::string& seal)>& visit);
/// The first column of the first row; 0 without one.
[[nodiscard]] std::int64_t one_integer(Database& database, const char* sql);

}  // namespace knothe::service
