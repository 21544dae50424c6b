#pragma once
/// @file What people should know of a site, as it is told and kept.
#include <cstdint>
#include <string>

namespace knothe::service {

/// Something began to hold at a step; with an empty severity, that it holds no more (kept, not told).
struct Alarm {
  std::int64_t id = 0;  ///< of its event, increasing for ever
  std::int64_t step = 0;
  std::string severity, kind, message;
  std::string condition;  ///< what holds; the same until it holds no more. Empty: it happened, and is over
  std::int64_t raised_ms = 0;  ///< Unix time
};

}  // namespace knothe::service
