#pragma once
/// @file What people should know of a site, as it is told and kept.
#include <cstdint>
#include <optional>
#include <string>

namespace knothe::service {

/// Who has seen to an alarm, and what they said.
struct Acknowledgement {
  std::string by, comment;
  std::int64_t at_ms = 0;  ///< Unix time
  std::int64_t event = 0;  ///< id of the event that told it
};

/// Something began to hold at a step; with an empty severity, that it holds no more (kept, not told).
struct Alarm {
  std::int64_t id = 0;  ///< of its event, increasing for ever
  std::int64_t step = 0;
  std::string severity, kind, message;
  std::string condition;  ///< what holds; the same until it holds no more. Empty: it happened, and is over
  std::int64_t raised_ms = 0;  ///< Unix time
  std::optional<Acknowledgement> acknowledged = {};
};

}  // namespace knothe::service
