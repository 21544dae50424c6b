#pragma once
/// @file Stopping long work politely: Ctrl-C asks, the work stops at its next safe point and keeps what it
/// has.
#include <string>

namespace knothe {

/// Whether the user asked to stop (SIGINT or SIGTERM, once `install_signal_handlers` was called).
[[nodiscard]] bool cancellation_requested() noexcept;

/// Asks to stop, or takes that back; signals do the same. Safe from any thread.
void request_cancellation(bool stop = true) noexcept;

/// From now on the first SIGINT or SIGTERM only asks to stop; a second one ends the program at once.
void install_signal_handlers();

/// Throws Interrupted if the user asked to stop. `saved` tells what is kept, e.g. "12 of 49 runs are kept in
/// …".
void check_cancellation(const std::string& saved);

}  // namespace knothe
