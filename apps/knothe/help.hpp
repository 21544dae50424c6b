#pragma once
/// @file What `knothe` says of itself: its commands by task, help in lines that people read, and what was
/// meant by a misspelt word.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <sstream>
#include <string>
#include <vector>

#include "knothe/base/console.hpp"
#include "knothe/base/text.hpp"

namespace knothe::commands {

/// "asimilate" where a command is expected, with the nearest one; empty if the mistake is another. CLI11 only
/// says that a command is required.
inline std::string unknown_command(const CLI::App& app, int argc, char** argv) {
  const CLI::App* current = &app;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    std::vector<std::string> names;
    for (const CLI::App* command : current->get_subcommands([](const CLI::App*) { return true; })) {
      names.push_back(command->get_name());
    }
    if (names.empty() || word.starts_with("-")) return "";
    if (std::find(names.begin(), names.end(), word) == names.end()) {
      return "unknown command \"" + word + "\"" + did_you_mean(word, names);
    }
    current = current->get_subcommand(word);
  }
  return "";
}

/// Of an option that its command does not have, with the nearest that it has; empty if there is none.
inline std::string unknown_option(const CLI::App& app, int argc, char** argv) {
  const CLI::App* command = &app;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i], name = word.substr(0, word.find('='));
    if (!word.starts_with("-")) {
      const auto found =
          command->get_subcommands([&](const CLI::App* one) { return one->get_name() == word; });
      if (!found.empty()) command = found.front();
      continue;
    }
    if (name == "--") break;
    std::vector<std::string> names;
    for (const CLI::Option* option : command->get_options())
      for (const std::string& known : option->get_lnames()) names.push_back("--" + known);
    if (!name.starts_with("--") || std::find(names.begin(), names.end(), name) != names.end()) continue;
    return "unknown option " + name + did_you_mean(name, names);
  }
  return "";
}

struct Task {
  const char* name;
  std::vector<const char*> commands;
};

/// The commands in the order in which a test needs them.
inline std::string commands_by_task(const CLI::App& app) {
  static const std::vector<Task> k_tasks = {
      {"Prepare a model", {"check", "offline", "model", "simulate", "select"}},
      {"Assimilate a test", {"assimilate", "dic", "forecast", "report", "population"}},
      {"Assimilate while a test runs", {"serve", "replay", "export", "backup", "recover"}},
      {"Infer the parameters of any model", {"infer"}},
      {"Look after the installation", {"doctor", "reproduce"}}};
  std::string text = app.get_description() + "\n";
  for (const Task& task : k_tasks) {
    text += std::string("\n") + task.name + "\n";
    for (const std::string name : task.commands) {
      const std::string line = "  " + name + std::string(14 - name.size(), ' ');
      text += wrapped(line + app.get_subcommand(name)->get_description(), k_line_width, 14) + "\n";
    }
  }
  return text + "\nknothe help COMMAND, or knothe COMMAND --help: its options, with an example.\n";
}

/// Long texts in lines of at most `k_line_width` characters.
class WrappingFormatter : public CLI::Formatter {
 public:
  std::string make_description(const CLI::App* app) const override {
    return wrapped(CLI::Formatter::make_description(app));
  }
  std::string make_subcommand(const CLI::App* command) const override {
    std::ostringstream out;
    CLI::detail::format_help(out, command->get_name(), beside_name(command->get_description()),
                             column_width_);
    return out.str();
  }
  std::string make_option_desc(const CLI::Option* option) const override {
    return beside_name(option->get_description());
  }

 private:
  [[nodiscard]] std::string beside_name(const std::string& text) const {
    return wrapped(text, k_line_width - column_width_);
  }
};

}  // namespace knothe::commands
