/// @file `knothe`: the command line of the online program. Parsing only; each command is a file of its own.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <functional>
#include <string>

#include "apps/guarded_main.hpp"
#include "apps/knothe/commands.hpp"
#include "apps/knothe/sibling_commands.hpp"
#include "knothe/assimilation/update/method.hpp"
#include "knothe/base/text.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/reduction/model/form_names.hpp"

namespace {

using namespace knothe::commands;  // NOLINT: this file is about nothing else

void add_model(CLI::App& app, Command& chosen) {
  static ModelArguments info;
  static EvaluateArguments evaluate;
  static ImportArguments import;
  CLI::App& model = *app.add_subcommand("model", "Looks at, evaluates, makes and verifies separated models.");
  model.require_subcommand(1);

  CLI::App& info_command = add(model, "info", "Modes, axes, sizes, units, build record, error estimate.",
                               "knothe model info beam.h5");
  info_command.add_option("MODEL", info.model, "model file")->required();
  info_command.add_flag("--json", info.json, "one line of JSON");
  info_command.callback([&chosen] { chosen = [] { return model_info(info); }; });

  CLI::App& evaluate_command =
      add(model, "evaluate", "Values and derivatives at a parameter point and step, or the whole field.",
          "knothe model evaluate beam.h5 --at Y0=1,Ad=0.9 --step 20 --dofs 0,1 --derivatives --json");
  evaluate_command.add_option("MODEL", evaluate.model, "model file")->required();
  evaluate_command.add_option("--at", evaluate.at, "NAME=VALUE,… for every parameter")->required();
  evaluate_command.add_option("--step", evaluate.step, "index of the time step, from 0")->required();
  evaluate_command.add_option("--dofs", evaluate.dofs, "indices of dofs; all without it")->delimiter(',');
  evaluate_command.add_flag("--derivatives", evaluate.derivatives, "gradient and Hessian too");
  evaluate_command.add_flag("--json", evaluate.json, "one line of JSON");
  evaluate_command.add_option("-o,--output", evaluate.output, "field file to write (.vtu)");
  evaluate_command.callback([&chosen] { chosen = [] { return model_evaluate(evaluate); }; });

  CLI::App& import_command = add(model, "import", "Separated model from any solver's snapshots.",
                                 "knothe model import snapshots.h5 -o model.h5 --form tree --modes 30");
  import_command.add_option("SNAPSHOTS", import.snapshots, "snapshot file")->required();
  import_command.add_option("-o,--output", import.output, "model file to write")->required();
  import_command.add_option("--form", import.form, "canonical or tree")
      ->check(CLI::IsMember(knothe::words_of<knothe::reduction::Form>()))
      ->capture_default_str();
  import_command.add_option("--modes", import.modes, "number of modes")->check(CLI::PositiveNumber);
  import_command.add_option("--tolerance", import.tolerance, "relative L² error")->check(CLI::PositiveNumber);
  import_command.callback([&chosen] { chosen = [] { return model_import(import); }; });
  add_verify(model, chosen);
  add_mesh_study(model, chosen);
  add_full_order(model, chosen);
}

void add_simulate(CLI::App& app, Command& chosen) {
  static SimulateArguments arguments;
  CLI::App& command = add(app, "simulate", "Synthetic measurements from the reduced or the full-order model.",
                          "knothe simulate examples/beam/quick.toml --model examples/beam/beam.h5 \\\n    -o "
                          "examples/beam/data.h5 --seed 1");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_option("--model", arguments.model, "reduced model; without it the full-order model is run");
  command.add_option("-o,--output", arguments.output, "measurement file to write; with --images a folder")
      ->required();
  command.add_flag("--images", arguments.images,
                   "pictures of the test instead, by [simulate.camera] and [dic]");
  command.add_option("--seed", arguments.seed, "seed of nodes and noise");
  command.callback([&chosen] { chosen = [] { return simulate(arguments); }; });
}

void add_assimilate(CLI::App& app, Command& chosen) {
  static AssimilateArguments arguments;
  CLI::App& command = add(app, "assimilate", "Sequential assimilation of recorded data.",
                          "knothe assimilate examples/beam/quick.toml");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_option("--method", arguments.method, "transport, grid, mcmc, smc, ekf, ukf or enkf")
      ->check(CLI::IsMember(knothe::words_of<knothe::assimilation::Method>()));
  command.add_option("--redo", arguments.redo,
                     "FROM:TO: these steps with the model corrected for its bias, later ones as they follow");
  command.add_flag("--json", arguments.json, "one line of JSON per step on stdout");
  command.add_option("-o,--output", arguments.results, "folder for results");
  command.callback([&chosen] { chosen = [] { return assimilate(arguments); }; });
}

void add_select(CLI::App& app, Command& chosen) {
  static SelectArguments arguments;
  CLI::App& command = add(app, "select", "Data selection: which dofs tell most about the parameters.",
                          "knothe select examples/beam/quick.toml");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_flag("--json", arguments.json, "JSON lines on stdout");
  command.add_option("-o,--output", arguments.results, "folder for results");
  // Not the name alone: there is a select() in the C library.
  command.callback([&chosen] { chosen = [] { return knothe::commands::select(arguments); }; });
}

void add_infer(CLI::App& app, Command& chosen) {
  static InferArguments arguments;
  CLI::App& command =
      add(app, "infer", "One-shot inference for any forward model (UM-Bridge server, separated model).",
          "knothe infer examples/umbridge/infer.toml --compare transport,mcmc");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_option("--method", arguments.method, "transport, mcmc, smc or grid")
      ->check(CLI::IsMember({"transport", "mcmc", "smc", "grid"}));
  command.add_option("--compare", arguments.compare, "two methods, e.g. transport,smc: their differences");
  command.add_flag("--json", arguments.json, "one line of JSON on stdout");
  command.add_option("-o,--output", arguments.results, "folder for results");
  command.callback([&chosen] { chosen = [] { return infer(arguments); }; });
}

void add_dic(CLI::App& app, Command& chosen) {
  static DicArguments arguments;
  CLI::App& command =
      add(app, "dic", "Image correlation: displacements from pictures.",
          "knothe dic reference.tif a.tif b.tif --roi 100,60,1100,900 --element-size 25 -o u.h5");
  command.add_option("FILES", arguments.files, "project file, or REFERENCE DEFORMED…")->required();
  command.add_option("--element-size", arguments.element_size, "size of the elements, px")
      ->check(CLI::PositiveNumber);
  command.add_option("--roi", arguments.region, "X0,Y0,X1,Y1: two opposite corners of the mesh, px")
      ->delimiter(',');
  command.add_option("--mask", arguments.mask, "picture that is 0 where the surface is not to be measured");
  command.add_option("--mesh", arguments.mesh,
                     "mesh to correlate on instead of equal elements: Gmsh (.msh) or VTK (.vtu), in px");
  command.add_option("--prefilter", arguments.prefilter, "Gaussian on all pictures, px")
      ->check(CLI::NonNegativeNumber);
  command.add_option("--at", arguments.at,
                     "CSV x,y: points of the reference picture to give displacements at");
  command.add_option("-o,--output", arguments.output,
                     ".h5, .vtu or .pvd; with --at a CSV file, or a folder for several pictures");
  command.add_option("--maps", arguments.maps, "folder for maps over the picture (.png)");
  command.add_flag(
      "--pattern", arguments.pattern,
      "before a test: is the speckle of the reference picture good enough, and how exactly will it measure?");
  command.add_option("--table", arguments.table,
                     "file (.txt, .json, .html) for the settings and noise floor that a report should hold");
  command.add_flag("--resume", arguments.resume,
                   "go on with the pictures that the output file (.h5) does not hold yet");
  command.add_flag("--crack", arguments.crack, "path, opening and tip of a crack in every picture");
  command.add_flag("--json", arguments.json, "one line of JSON per picture on stdout");
  command.callback([&chosen] { chosen = [] { return dic(arguments); }; });
}

void add_forecast(CLI::App& app, Command& chosen) {
  static ForecastArguments arguments;
  CLI::App& command = add(app, "forecast", "Forecasts of quantities of interest from the results.",
                          "knothe forecast examples/beam/quick.toml --json");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_flag("--json", arguments.json, "one line of JSON");
  command.callback([&chosen] { chosen = [] { return forecast(arguments); }; });
}

void add_report(CLI::App& app, Command& chosen) {
  static ReportArguments arguments;
  CLI::App& command = add(app, "report", "A self-contained page of figures and tables.",
                          "knothe report examples/beam/results -o report.html");
  command.add_option("RESULTS", arguments.results, "folder of results")->required();
  command
      .add_option("-o,--output", arguments.output,
                  "page to write (.html), or its overview as one picture (.svg)")
      ->required();
  command.callback([&chosen] { chosen = [] { return report(arguments); }; });
}

void add_check(CLI::App& app, Command& chosen) {
  static CheckArguments arguments;
  CLI::App& command = add(app, "check", "Validates a project file completely, runs nothing.",
                          "knothe check examples/beam/beam.toml");
  command.add_option("FILE", arguments.project, "project file");
  command.add_flag("--options", arguments.options, "print the reference of all options instead");
  command.callback([&chosen] { chosen = [] { return check(arguments); }; });
}

void add_serve(CLI::App& app, Command& chosen) {
  static ServeArguments arguments;
  static int port = -1;
  CLI::App& command =
      add(app, "serve", "The online service: measurements in, posterior and forecast out, a page.",
          "knothe serve examples/beam/quick.toml --port 8080");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_option("--port", port, "port to listen at, 0 for a free one; overrides [serve] port")
      ->check(CLI::Range(0, 65535));
  command.add_flag("--strict-deadline", arguments.strict_deadline,
                   "stop with status 7 at the first update later than its budget");
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
      add(app, "replay", "Verifies a journal and computes the posterior that it gives.",
          "knothe replay beam.journal --project beam.toml --json");
  CLI::App& recover_command = add(app, "recover", "Saves the whole records of a damaged journal.",
                                  "knothe recover beam.journal -o saved.journal");
  CLI::App& export_command = add(app, "export", "A journal as CSV, or as a folder of results (NetCDF, VTU).",
                                 "knothe export beam.journal --project beam.toml -o results/");
  for (CLI::App* command : {&replay_command, &recover_command, &export_command})
    command->add_option("JOURNAL", arguments.journal, "journal of the service")->required();
  for (CLI::App* command : {&replay_command, &export_command})
    command->add_option("--project", arguments.project,
                        "project file; without it NAME.toml beside NAME.journal");
  replay_command.add_flag("--json", arguments.json, "one line of JSON per step on stdout");
  recover_command.add_option("-o,--output", arguments.output, "journal to write")->required();
  export_command.add_option("-o,--output", arguments.output, "file .csv, or folder for results")->required();
  replay_command.callback([&chosen] { chosen = [] { return replay(arguments); }; });
  recover_command.callback([&chosen] { chosen = [] { return recover(arguments); }; });
  export_command.callback([&chosen] { chosen = [] { return export_journal(arguments); }; });
}

void add_doctor(CLI::App& app, Command& chosen) {
  CLI::App& command =
      add(app, "doctor", "What is installed, BLAS, cores, disk, permissions.", "knothe doctor");
  command.callback([&chosen] { chosen = [] { return doctor(); }; });
}

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

int main(int argc, char** argv) {
  CLI::App app(
      "Real-time Bayesian data assimilation: measurements in, posterior and forecast out.\n"
      "Start with examples/beam/quick.toml, or `make demo`.",
      "knothe");
  app.set_version_flag("--version", std::string("knothe ") + knothe::k_version);
  app.require_subcommand(1);
  Command chosen;
  add_check(app, chosen);
  add_offline(app, chosen);
  add_model(app, chosen);
  add_simulate(app, chosen);
  add_assimilate(app, chosen);
  add_select(app, chosen);
  add_infer(app, chosen);
  add_dic(app, chosen);
  add_forecast(app, chosen);
  add_report(app, chosen);
  add_serve(app, chosen);
  add_journal(app, chosen);
  add_reproduce(app, chosen);
  add_doctor(app, chosen);
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
