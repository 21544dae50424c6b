/// @file The service and its journal, as a person types them.
#include "apps/knothe/command_line.hpp"

namespace knothe::commands {

namespace {

void add_serve(CLI::App& app, Command& chosen) {
  static ServeArguments arguments;
  static int port = -1;
  CLI::App& command =
      add_command(app, "serve", "The online service: measurements in, posterior and forecast out, a page.",
                  "knothe serve examples/beam/quick.toml --port 8080");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_option("--port", port, "port to listen at, 0 for a free one; overrides [serve] port")
      ->check(CLI::Range(0, 65535));
  command.add_option("--test", arguments.test,
                     "name of the test to start or resume: letters, digits, - and _; its journal is "
                     "NAME.TEST.journal. Default: the unnamed one. If the running service has since "
                     "moved on to another test (POST /v1/tests), that test is served");
  command.add_flag("--strict-deadline", arguments.strict_deadline,
                   "stop with status 7 at the first update that exceeds its budget");
  command.callback([&chosen] {
    chosen = [] {
      if (port >= 0) arguments.port = port;
      return serve(arguments);
    };
  });
}

void add_journal(CLI::App& app, Command& chosen) {
  static JournalArguments arguments;
  CLI::App& replay_command =
      add_command(app, "replay", "Verifies a journal and computes the posterior that it gives.",
                  "knothe replay beam.journal --project beam.toml --json");
  CLI::App& recover_command = add_command(app, "recover", "Saves the intact records of a damaged journal.",
                                          "knothe recover beam.journal -o saved.journal");
  CLI::App& backup_command = add_command(app, "backup", "Copies a journal, also while the service writes it.",
                                         "knothe backup beam.journal -o beam-monday.journal");
  CLI::App& export_command =
      add_command(app, "export", "A journal as CSV, or as a folder of results (NetCDF, VTU).",
                  "knothe export beam.journal --project beam.toml -o results/");
  for (CLI::App* command : {&replay_command, &recover_command, &backup_command, &export_command})
    command->add_option("JOURNAL", arguments.journal, "journal of the service")->required();
  for (CLI::App* command : {&replay_command, &export_command})
    command->add_option("--project", arguments.project,
                        "project file; without it NAME.toml beside NAME.journal");
  replay_command.add_flag("--json", arguments.json, "one line of JSON per step on stdout");
  for (CLI::App* command : {&recover_command, &backup_command})
    command->add_option("-o,--output", arguments.output, "journal to write")->required();
  export_command.add_option("-o,--output", arguments.output, "file .csv, or folder for results")->required();
  replay_command.callback([&chosen] { chosen = [] { return replay(arguments); }; });
  recover_command.callback([&chosen] { chosen = [] { return recover(arguments); }; });
  backup_command.callback([&chosen] { chosen = [] { return backup(arguments); }; });
  export_command.callback([&chosen] { chosen = [] { return export_journal(arguments); }; });
}

void add_doctor(CLI::App& app, Command& chosen) {
  static std::string project;
  CLI::App& command = add_command(
      app, "doctor", "What is installed, BLAS, cores, disk, permissions; and whether a service can run here.",
      "knothe doctor beam.toml");
  command.add_option("FILE", project, "project file of the service: its model, journal, port, tokens, clock");
  static bool sends_alarms = false;
  command.add_flag("--test-alarms", sends_alarms, "send a test message by each channel of [serve.notify]");
  command.callback([&chosen] { chosen = [] { return doctor(project, sends_alarms); }; });
}

}  // namespace

void add_service_commands(CLI::App& app, Command& chosen) {
  add_serve(app, chosen);
  add_journal(app, chosen);
  add_doctor(app, chosen);
}

}  // namespace knothe::commands
