#pragma once
/// @file The commands that `knothe` passes on to its sibling `knothe-offline`, and what every command begins
/// with.
#include <CLI/CLI.hpp>
#include <functional>
#include <string>

namespace knothe::commands {

using Command = std::function<int()>;

/// A subcommand with a description and one worked example.
CLI::App& add(CLI::App& parent, const std::string& name, const std::string& meaning,
              const std::string& example);

/// Each sets `chosen` when its command is on the command line.
void add_offline(CLI::App& app, Command& chosen);
void add_reproduce(CLI::App& app, Command& chosen);
void add_verify(CLI::App& model, Command& chosen);
void add_mesh_study(CLI::App& model, Command& chosen);
void add_full_order(CLI::App& model, Command& chosen);

}  // namespace knothe::commands
