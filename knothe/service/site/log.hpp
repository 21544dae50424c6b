#pragma once
/// @file Structured logs: one JSON object a line on stderr, each line written at once.
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace knothe::service {

using Json = nlohmann::ordered_json;

/// `level`: "info", "warning", "error"; `what` in words that stay the same; `more` are members beside them.
void log_event(const std::string& level, const std::string& what, const Json& more);

}  // namespace knothe::service
