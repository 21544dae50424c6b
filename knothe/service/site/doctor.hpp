#pragma once
/// @file Whether a machine is fit for knothe, and for a service.
#include <string>

namespace knothe::service {

/// Prints what is installed and how fast the disk is and, with a project file, whether its service can run
/// here: model, sensors, journal, tokens, address, clock. False if something is wrong. Changes nothing; with
/// `sends_alarms` a test message goes out by each of the project's channels.
[[nodiscard]] bool doctor(const std::string& folder, bool offline_installed, const std::string& project,
                          bool sends_alarms);

}  // namespace knothe::service
