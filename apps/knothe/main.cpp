/// @file `knothe`: the command line of the online program.
#include <cstdio>
#include <memory>
#include <string_view>
#include <vector>

#include "apps/guarded_main.hpp"
#include "apps/knothe/command_line.hpp"
#include "apps/knothe/help.hpp"
#include "knothe/base/version.hpp"

namespace {

constexpr int k_wrong_usage = static_cast<int>(knothe::ExitStatus::usage);

}  // namespace

// Visible, because in packages it is entered from outside: cmake/KnotheDispatch.cmake.
[[gnu::visibility("default")]] int main(int argc, char** argv) {
  CLI::App app(
      "Real-time Bayesian data assimilation: measurements in, posterior and forecast out.\n"
      "Start with examples/beam/quick.toml, or `make demo`.",
      "knothe");
  app.formatter(std::make_shared<knothe::commands::WrappingFormatter>());
  app.set_version_flag("-V,--version", std::string("knothe ") + knothe::k_version);
  app.require_subcommand(1);
  knothe::Command chosen;
  knothe::commands::add_project_commands(app, chosen);
  knothe::commands::add_offline_commands(app, chosen);
  knothe::commands::add_model_commands(app, chosen);
  knothe::commands::add_service_commands(app, chosen);
  if (argc == 1) {
    std::fputs(knothe::commands::commands_by_task(app).c_str(), stderr);
    return k_wrong_usage;
  }
  std::vector<char*> words(argv, argv + argc);
  static char help[] = "--help";
  if (std::string_view(argv[1]) == "help") {
    if (argc == 2) return std::fputs(knothe::commands::commands_by_task(app).c_str(), stdout) < 0 ? 1 : 0;
    words.erase(words.begin() + 1);
    words.push_back(help);
  }
  argc = words.size(), argv = words.data();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    // A request for help is one of these, with a misspelt command before it too.
    std::string unknown = knothe::commands::unknown_command(app, argc, argv);
    if (unknown.empty() && error.get_exit_code() != 0)
      unknown = knothe::commands::unknown_option(app, argc, argv);
    if (!unknown.empty()) {
      std::fprintf(stderr, "knothe: error: %s\nRun with --help for more information.\n", unknown.c_str());
      return k_wrong_usage;
    }
    return app.exit(error) == 0 ? 0 : k_wrong_usage;
  }
  return knothe::guarded_main("knothe", chosen);
}
