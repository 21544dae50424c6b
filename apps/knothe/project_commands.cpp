/// @file The commands that take a project file, pictures or results, as a person types them.
#include "apps/knothe/command_line.hpp"
#include "knothe/posterior/method.hpp"

namespace knothe::commands {

namespace {

void add_simulate(CLI::App& app, Command& chosen) {
  static SimulateArguments arguments;
  CLI::App& command = add(app, chosen, arguments, simulate, "simulate",
                          "Synthetic measurements from the reduced or the full-order model.",
                          "knothe simulate examples/beam/quick.toml --model examples/beam/beam.h5 \\\n    -o "
                          "examples/beam/data.h5 --seed 1");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_option("--model", arguments.model, "reduced model; without it the full-order model is run");
  command.add_option("-o,--output", arguments.output, "measurement file to write; with --images a folder")
      ->required();
  command.add_flag("--images", arguments.images,
                   "pictures of the test instead, by [simulate.camera] and [dic]");
  command.add_option("--seed", arguments.seed, "seed of nodes and noise");
}

void add_assimilate(CLI::App& app, Command& chosen) {
  static AssimilateArguments arguments;
  CLI::App& command =
      add(app, chosen, arguments, assimilate, "assimilate", "Sequential assimilation of recorded data.",
          "knothe assimilate examples/beam/quick.toml");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_option("--method", arguments.method, "transport, grid, mcmc, smc, ekf, ukf or enkf")
      ->check(CLI::IsMember(words_of<posterior::Method>()));
  command.add_option(
      "--redo", arguments.redo,
      "FROM:TO: assimilate these steps again with the model corrected for its bias, and then the later ones");
  command.add_flag("--json", arguments.json, "one line of JSON per step on stdout");
  command.add_option("-o,--output", arguments.results, "folder for results");
}

void add_select(CLI::App& app, Command& chosen) {
  static SelectArguments arguments;
  CLI::App& command = add(app, chosen, arguments, commands::select, "select",
                          "Data selection: the dofs that are most informative about the parameters.",
                          "knothe select examples/beam/quick.toml");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_flag("--json", arguments.json, "JSON lines on stdout");
  command.add_option("-o,--output", arguments.results, "folder for results");
}

void add_infer(CLI::App& app, Command& chosen) {
  static InferArguments arguments;
  CLI::App& command = add(app, chosen, arguments, infer, "infer",
                          "One-shot inference for any forward model (UM-Bridge server, separated model).",
                          "knothe infer examples/umbridge/infer.toml --compare transport,mcmc");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_option("--method", arguments.method, "auto, transport, mcmc, smc or grid")
      ->check(CLI::IsMember({"auto", "transport", "mcmc", "smc", "grid"}));
  command.add_option("--compare", arguments.compare, "two methods, e.g. transport,smc: their differences");
  command.add_flag("--json", arguments.json, "one line of JSON on stdout");
  command.add_option("-o,--output", arguments.results, "folder for results");
}

void add_forecast(CLI::App& app, Command& chosen) {
  static ForecastArguments arguments;
  CLI::App& command = add(app, chosen, arguments, forecast, "forecast",
                          "Forecasts of quantities of interest from the results.",
                          "knothe forecast examples/beam/quick.toml --json");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_flag(
      "--inverse-map", arguments.inverse_map,
      "Eq. 33 of the paper with the inverse transport map of the predicted field, not a normal one");
  command.add_flag("--json", arguments.json, "one line of JSON");
}

void add_report(CLI::App& app, Command& chosen) {
  static ReportArguments arguments;
  CLI::App& command =
      add(app, chosen, arguments, report, "report", "A self-contained page of figures and tables.",
          "knothe report examples/beam/results -o report.html");
  command.add_option("RESULTS", arguments.results, "folder of results")->required();
  command.add_option("-o,--output", arguments.output, "page to write (.html)")->required();
}

void add_check(CLI::App& app, Command& chosen) {
  static CheckArguments arguments;
  CLI::App& command =
      add(app, chosen, arguments, check, "check", "Validates a project file completely, runs nothing.",
          "knothe check examples/beam/beam.toml");
  command.add_option("FILE", arguments.project, "project file");
  command.add_flag("--options", arguments.options, "print the reference of all options instead");
  command.add_flag("--schema", arguments.schema,
                   "print JSON Schemas of the lines that --json writes instead");
}

}  // namespace

void add_project_commands(CLI::App& app, Command& chosen) {
  add_check(app, chosen);
  add_simulate(app, chosen);
  add_assimilate(app, chosen);
  add_select(app, chosen);
  add_infer(app, chosen);
  add_population(app, chosen);
  add_dic(app, chosen);
  add_forecast(app, chosen);
  add_report(app, chosen);
}

}  // namespace knothe::commands
