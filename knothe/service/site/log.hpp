#pragma once
/// @file Structured logs: one JSON object a line on stderr, each line written at once.
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace knothe::service {

using Json = nlohmann::ordered_json;

/// `level`: "info", "warning", "error"; `what` in words that stay the same; `more` are members beside them.
/// A line that would have to wait for a reader is lost, and the next one that is written says how many were.
void log_event(const std::string& level, const std::string& what, const Json& more);

/// From now on nothing that is written to stderr waits for its reader: the program can end.
void end_log();

}  // namespace knothe::service
