#pragma once
/// @file The journal's tables, and how those of an older schema become the present ones. Private to the room.
#include <cstdint>

#include "knothe/service/journal/sqlite.hpp"

namespace knothe::service {

/// 1: records and releases (0.1); 2: a measurement's own noise; 3: withdrawals, several records of a key; 4:
/// alarms, the journal's own number; 5: the logbook; 6: files of watched folders.
[[nodiscard]] std::int64_t schema_of(Database& database);
[[nodiscard]] bool is_empty(Database& database);
/// DataError where it is no journal, or of a schema that is not known.
void check_schema(Database& database);
/// From an empty file, or an older schema, to the present one, in one transaction.
void migrate(Database& database);

}  // namespace knothe::service
