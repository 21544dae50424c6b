#pragma once
/// @file How the commands of `knothe` are typed. Each sets `chosen` when it is on the command line.
#include "apps/knothe/commands.hpp"
#include "apps/offline_command_line.hpp"

namespace knothe::commands {

/// A command that runs `run` with `arguments`, which must outlive the parsing.
template <typename Arguments>
CLI::App& add(CLI::App& parent, Command& chosen, Arguments& arguments, int (*run)(const Arguments&),
              const std::string& name, const std::string& meaning, const std::string& example) {
  CLI::App& command = add_command(parent, name, meaning, example);
  command.callback([&chosen, &arguments, run] { chosen = [&arguments, run] { return run(arguments); }; });
  return command;
}

void add_dic(CLI::App& app, Command& chosen);
void add_population(CLI::App& app, Command& chosen);
void add_project_commands(CLI::App& app, Command& chosen);
void add_offline_commands(CLI::App& app, Command& chosen);
void add_model_commands(CLI::App& app, Command& chosen);
void add_service_commands(CLI::App& app, Command& chosen);

}  // namespace knothe::commands
