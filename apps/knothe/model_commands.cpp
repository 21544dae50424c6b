/// @file The commands that make and look at models; those of the offline phase are done by `knothe-offline`.
#include <fmt/format.h>

#include "apps/knothe/command_line.hpp"
#include "apps/number_checks.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/model/reduced/form_names.hpp"

namespace knothe::commands {

namespace {

/// The same command with all of its arguments that were given, as another program's command line.
std::vector<std::string> command_words(const CLI::App& command) {
  std::vector<std::string> words = {command.get_name()};
  for (const CLI::Option* option : command.get_options()) {
    if (option->count() == 0) continue;
    if (!option->get_positional()) words.push_back(option->get_name());
    if (option->get_items_expected_max() > 0)  // no flag
      words.push_back(fmt::format("{}", fmt::join(option->results(), ",")));
  }
  return words;
}

/// Passes the command that reads `Arguments` on, as it was typed.
template <typename Arguments>
void forward(CLI::App& parent, Command& chosen, void (*check)(const Arguments&) = nullptr) {
  static Arguments arguments;
  CLI::App& command = add_command(parent, arguments);
  command.callback([&command, &chosen, check] {
    chosen = [&command, check] {
      if (check != nullptr) check(arguments);
      return run_sibling(command_words(command));
    };
  });
}

}  // namespace

void add_offline_commands(CLI::App& app, Command& chosen) {
  forward<BuildArguments>(app, chosen, [](const BuildArguments& arguments) {
    files::refuse_overwriting(arguments.output, {arguments.project});
  });
  forward<ReproduceArguments>(app, chosen);
}

void add_model_commands(CLI::App& app, Command& chosen) {
  static ModelArguments info;
  static EvaluateArguments evaluate;
  static ImportArguments import;
  CLI::App& model =
      *app.add_subcommand("model", "Inspects, evaluates, imports and verifies separated models.");
  model.require_subcommand(1);

  CLI::App& info_command =
      add(model, chosen, info, model_info, "info", "Modes, axes, sizes, units, build record, error estimate.",
          "knothe model info beam.h5");
  info_command.add_option("MODEL", info.model, "model file")->required();
  info_command.add_flag("--json", info.json, "one line of JSON");

  CLI::App& evaluate_command =
      add(model, chosen, evaluate, model_evaluate, "evaluate",
          "Values and derivatives at a parameter point and step, or the whole field.",
          "knothe model evaluate beam.h5 --at Y0=1,Ad=0.9 --step 20 --dofs 0,1 --derivatives --json");
  evaluate_command.add_option("MODEL", evaluate.model, "model file")->required();
  evaluate_command.add_option("--at", evaluate.at, "NAME=VALUE,… for every parameter")->required();
  evaluate_command.add_option("--step", evaluate.step, "index of the time step, from 0")->required();
  evaluate_command.add_option("--dofs", evaluate.dofs, "indices of dofs (default: all)")->delimiter(',');
  evaluate_command.add_flag("--derivatives", evaluate.derivatives, "gradient and Hessian too");
  evaluate_command.add_flag("--json", evaluate.json,
                            "print the line of JSON with -o too (without -o it is always printed)");
  evaluate_command.add_option("-o,--output", evaluate.output, "field file to write (.vtu)");

  CLI::App& import_command =
      add(model, chosen, import, model_import, "import",
          "Separated model from any solver's snapshots (the file: docs/reference/formats.md#snapshots).",
          "knothe model import snapshots.h5 -o model.h5 --form tree --modes 30");
  import_command.add_option("SNAPSHOTS", import.snapshots, "snapshot file")->required();
  import_command.add_option("-o,--output", import.output, "model file to write")->required();
  import_command.add_option("--form", import.form, "canonical or tree")
      ->check(CLI::IsMember(words_of<model::Form>()))
      ->capture_default_str();
  import_command.add_option("--modes", import.modes, "number of modes")->check(positive_number());
  import_command.add_option("--tolerance", import.tolerance, "relative L² error")->check(positive_number());
  import_command.add_flag("--json", import.json, "one line of JSON");
  forward<VerifyArguments>(model, chosen);
  forward<MeshStudyArguments>(model, chosen);
  forward<FullOrderArguments>(model, chosen);
  forward<SolveArguments>(model, chosen, [](const SolveArguments& arguments) {
    files::refuse_overwriting(arguments.output, {arguments.project});
  });
}

}  // namespace knothe::commands
