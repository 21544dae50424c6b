#pragma once
/// @file Durations for reports: of the clock that never jumps.
#include <chrono>

namespace knothe {

using MonotonicTime = std::chrono::steady_clock::time_point;

[[nodiscard]] inline MonotonicTime monotonic_now() {
  return std::chrono::steady_clock::now();
}

[[nodiscard]] inline double microseconds_since(MonotonicTime start) {
  return std::chrono::duration<double, std::micro>(monotonic_now() - start).count();
}

[[nodiscard]] inline double seconds_between(MonotonicTime start, MonotonicTime end) {
  return std::chrono::duration<double>(end - start).count();
}

[[nodiscard]] inline double seconds_since(MonotonicTime start) {
  return seconds_between(start, monotonic_now());
}

}  // namespace knothe
