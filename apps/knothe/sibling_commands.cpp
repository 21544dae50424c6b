#include "apps/knothe/sibling_commands.hpp"

#include <utility>
#include <vector>

#include "apps/knothe/commands.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::commands {
namespace {

/// `words`, then the options that were given and the flags that are set.
int run_with(std::vector<std::string> words, const std::vector<std::pair<std::string, std::string>>& options,
             const std::vector<std::pair<std::string, bool>>& flags) {
  for (const auto& [name, value] : options)
    if (!value.empty()) words.insert(words.end(), {name, value});
  for (const auto& [name, is_set] : flags)
    if (is_set) words.push_back(name);
  return run_sibling(words);
}

}  // namespace

CLI::App& add(CLI::App& parent, const std::string& name, const std::string& meaning,
              const std::string& example) {
  CLI::App& command = *parent.add_subcommand(name, meaning);
  command.footer("Example:\n  " + example);
  return command;
}

void add_offline(CLI::App& app, Command& chosen) {
  static std::string project, model, method;
  static bool json = false;
  CLI::App& command = add(app, "offline", "Builds the reduced model of a project (runs knothe-offline).",
                          "knothe offline examples/beam/quick.toml -o examples/beam/beam.h5");
  command.add_option("FILE", project, "project file")->required();
  command.add_option("-o,--output", model, "model file to write")->required();
  command.add_option("--method", method, "how: snapshots or latin (default: the project's)");
  command.add_flag("--json", json, "JSON lines on stdout");
  command.callback([&] {
    chosen = [] {
      knothe::files::refuse_overwriting(model, {project});
      return run_with({"offline", project, "-o", model}, {{"--method", method}}, {{"--json", json}});
    };
  });
}

void add_reproduce(CLI::App& app, Command& chosen) {
  static std::string folder = "reproduction/";
  static unsigned long seed = 1;
  static bool quick = false, json = false;
  CLI::App& command =
      add(app, "reproduce",
          "The published study, figure by figure, beside its published values (runs knothe-offline).",
          "knothe reproduce --quick -o reproduction/\n"
          "writes reproduction/reproduce.html (open it in a browser) and reproduction/reproduce.json;\n"
          "models are kept in reproduction/models/ and used again.");
  command.add_flag("--quick", quick,
                   "fewer other choices and repetitions, same figures: minutes, not an hour");
  command.add_flag("--json", json, "JSON lines on stdout, one per row");
  command.add_option("-o,--output", folder, "folder for page, JSON file and models")->capture_default_str();
  command.add_option("--seed", seed, "seed of nodes and noise")->capture_default_str();
  command.callback([&] {
    chosen = [] {
      return run_with({"reproduce", "-o", folder, "--seed", std::to_string(seed)}, {},
                      {{"--quick", quick}, {"--json", json}});
    };
  });
}

void add_verify(CLI::App& model, Command& chosen) {
  static std::string project, file;
  static int points = 5;
  static unsigned long seed = 1;
  static bool json = false;
  CLI::App& command = add(model, "verify", "Error of a model against full-order runs (runs knothe-offline).",
                          "knothe model verify beam.toml beam.h5 --points 5 --seed 1");
  command.add_option("FILE", project, "project file with [offline]")->required();
  command.add_option("MODEL", file, "model file")->required();
  command.add_option("--points", points, "number of parameter points not used to build the model")
      ->capture_default_str();
  command.add_option("--seed", seed, "seed of the points")->capture_default_str();
  command.add_flag("--json", json, "JSON lines on stdout");
  command.callback([&] {
    chosen = [] {
      return run_with(
          {"verify", project, file, "--points", std::to_string(points), "--seed", std::to_string(seed)}, {},
          {{"--json", json}});
    };
  });
}

void add_mesh_study(CLI::App& model, Command& chosen) {
  static std::string project, elements, laws, steps, output;
  static bool json = false;
  CLI::App& command =
      add(model, "mesh-study",
          "Load, energy and crack length of the full-order model on several meshes (runs knothe-offline).",
          "knothe model mesh-study examples/beam/beam.toml -o mesh-study.svg");
  command.add_option("FILE", project, "project file with [offline]")->required();
  command.add_option("--elements", elements, "element sizes, m (default: 5e-3,2.5e-3,1.25e-3)");
  command.add_option("--laws", laws, "regularisations (default: none,crack-band,gradient)");
  command.add_option("--steps", steps, "load steps (default: the project's)");
  command.add_option("-o,--output", output, "figure to write (.svg)");
  command.add_flag("--json", json, "JSON lines on stdout");
  command.callback([&] {
    chosen = [] {
      return run_with({"mesh-study", project},
                      {{"--elements", elements}, {"--laws", laws}, {"--steps", steps}, {"-o", output}},
                      {{"--json", json}});
    };
  });
}

void add_full_order(CLI::App& model, Command& chosen) {
  static std::string project, refinements, steps, output;
  static bool elastic = false, json = false;
  CLI::App& command =
      add(model, "full-order",
          "One run of the full-order model (runs knothe-offline, which mpirun can distribute).",
          "knothe model full-order examples/beam/beam.toml -o beam.vtu");
  command.add_option("FILE", project, "project file with [offline]")->required();
  command.add_option("--refinements", refinements, "divide each cell into 8, so often (default: 0)");
  command.add_option("--steps", steps, "load steps (default: the project's)");
  command.add_option("-o,--output", output, "displacement and damage of the last step (.vtu)");
  command.add_flag("--elastic", elastic, "the elastic solution alone");
  command.add_flag("--json", json, "JSON lines on stdout");
  command.callback([&] {
    chosen = [] {
      return run_with({"full-order", project},
                      {{"--refinements", refinements}, {"--steps", steps}, {"-o", output}},
                      {{"--elastic", elastic}, {"--json", json}});
    };
  });
}

}  // namespace knothe::commands
