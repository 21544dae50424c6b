/// @file `knothe`: the command line of the online program.
#include <algorithm>
#include <cstdio>

#include "apps/guarded_main.hpp"
#include "apps/knothe/command_line.hpp"
#include "knothe/base/text.hpp"
#include "knothe/base/version.hpp"

namespace {

/// "asimilate" where a command is expected, with the nearest one; empty if the mistake is another. CLI11 only
/// says that a command is required.
std::string unknown_command(const CLI::App& app, int argc, char** argv) {
  const CLI::App* current = &app;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    std::vector<std::string> names;
    for (const CLI::App* command : current->get_subcommands([](const CLI::App*) { return true; })) {
      names.push_back(command->get_name());
    }
    if (names.empty() || word.starts_with("-")) return "";
    if (std::find(names.begin(), names.end(), word) == names.end()) {
      return "unknown command \"" + word + "\"" + knothe::did_you_mean(word, names);
    }
    current = current->get_subcommand(word);
  }
  return "";
}

}  // namespace

// Visible, because in packages it is entered from outside: cmake/KnotheDispatch.cmake.
[[gnu::visibility("default")]] int main(int argc, char** argv) {
  CLI::App app(
      "Real-time Bayesian data assimilation: measurements in, posterior and forecast out.\n"
      "Start with examples/beam/quick.toml, or `make demo`.",
      "knothe");
  app.set_version_flag("--version", std::string("knothe ") + knothe::k_version);
  app.require_subcommand(1);
  knothe::Command chosen;
  knothe::commands::add_project_commands(app, chosen);
  knothe::commands::add_offline_commands(app, chosen);
  knothe::commands::add_model_commands(app, chosen);
  knothe::commands::add_service_commands(app, chosen);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    // A request for help is one of these, with a misspelt command before it too.
    const std::string unknown = unknown_command(app, argc, argv);
    if (!unknown.empty()) {
      std::fprintf(stderr, "knothe: error: %s\nRun with --help for more information.\n", unknown.c_str());
      return static_cast<int>(knothe::ExitStatus::usage);
    }
    return app.exit(error) == 0 ? 0 : static_cast<int>(knothe::ExitStatus::usage);
  }
  return knothe::guarded_main("knothe", chosen);
}
