#include "apps/offline_command_line.hpp"

#include "apps/number_checks.hpp"
#include "knothe/project/offline_options.hpp"

namespace knothe {

CLI::App& add_command(CLI::App& parent, const std::string& name, const std::string& meaning,
                      const std::string& example) {
  CLI::App& command = *parent.add_subcommand(name, meaning);
  command.footer("Example:\n  " + example);
  return command;
}

CLI::App& add_command(CLI::App& parent, BuildArguments& arguments) {
  CLI::App& command =
      add_command(parent, "offline", "Builds the reduced model of a project (runs knothe-offline).",
                  "knothe offline examples/beam/quick.toml -o examples/beam/beam.h5");
  command.add_option("FILE", arguments.project, "project file")->required();
  command.add_option("-o,--output", arguments.output, "model file to write")->required();
  command.add_option("--method", arguments.method, "how: snapshots or latin (default: the project's)")
      ->check(CLI::IsMember(words_of<project::OfflineMethod>()));
  command.add_option("--refine", arguments.refine, "results folder: refines the model around its posterior");
  command.add_option("--share", arguments.share,
                     "I/N: compute only share I (from 0) of N, for a job array; then run once without it");
  command.add_flag("--study", arguments.study,
                   "also the errors that other numbers of modes would have, in both forms; takes longer");
  command.add_flag("--json", arguments.json, "JSON lines on stdout");
  return command;
}

CLI::App& add_command(CLI::App& parent, VerifyArguments& arguments) {
  CLI::App& command =
      add_command(parent, "verify", "Error of a model against new full-order runs (runs knothe-offline).",
                  "knothe model verify beam.toml beam.h5 --points 5 --seed 1");
  command.add_option("FILE", arguments.project, "project file with [offline]")->required();
  command.add_option("MODEL", arguments.model, "model file")->required();
  command.add_option("--points", arguments.points, "number of parameter points not used to build the model")
      ->check(positive_number())
      ->capture_default_str();
  command.add_option("--seed", arguments.seed, "seed of the points")->capture_default_str();
  command.add_flag("--json", arguments.json, "JSON lines on stdout");
  return command;
}

CLI::App& add_command(CLI::App& parent, MeshStudyArguments& arguments) {
  CLI::App& command = add_command(parent, "mesh-study",
                                  "Load, energy and crack length of the full-order model on several meshes, "
                                  "by damage law (runs knothe-offline).",
                                  "knothe model mesh-study examples/beam/beam.toml -o mesh-study.html");
  command.add_option("FILE", arguments.project, "project file with [offline]")->required();
  command.add_option("--elements", arguments.elements, "element sizes, m (default: 5e-3,2.5e-3,1.25e-3)")
      ->delimiter(',')
      ->check(positive_number());
  command.add_option("--laws", arguments.laws, "regularisations (default: none,crack-band,gradient)")
      ->delimiter(',')
      ->check(CLI::IsMember(words_of<project::DamageRegularisation>()));
  command.add_option("--steps", arguments.steps, "load steps (default: the project's)")
      ->check(positive_number());
  command.add_option("-o,--output", arguments.output, "page of the curves to write (.html)");
  command.add_flag("--json", arguments.json, "JSON lines on stdout");
  return command;
}

CLI::App& add_command(CLI::App& parent, FullOrderArguments& arguments) {
  CLI::App& command = add_command(
      parent, "full-order",
      "One run of the full-order model (runs knothe-offline, which mpirun can distribute).",
      "knothe model full-order examples/beam/beam.toml -o beam.vtu\n"
      "  mpirun -np 2 knothe-offline full-order examples/beam/beam.toml --refinements 1 --elastic");
  command.add_option("FILE", arguments.project, "project file with [offline]")->required();
  command
      .add_option("--refinements", arguments.refinements,
                  "number of refinements, each dividing every cell into 8 (0 to 6)")
      ->capture_default_str();
  command.add_option("--steps", arguments.steps, "load steps (default: the project's)")
      ->check(positive_number());
  command.add_flag("--elastic", arguments.elastic, "the elastic solution alone");
  command
      .add_option("--tolerance", arguments.tolerance,
                  "tolerance of the elastic solution: residual / right-hand side")
      ->check(positive_number())
      ->capture_default_str();
  command
      .add_option("--iterations", arguments.max_iterations, "maximum number of conjugate-gradient iterations")
      ->check(positive_number())
      ->capture_default_str();
  command.add_option("-o,--output", arguments.output, "displacement and damage of the last step (.vtu)");
  command.add_flag("--json", arguments.json, "JSON lines on stdout");
  return command;
}

CLI::App& add_command(CLI::App& parent, SolveArguments& arguments) {
  CLI::App& command =
      add_command(parent, "solve", "The full-order solution at one parameter point (runs knothe-offline).",
                  "knothe model solve beam.toml --at Y0=1.07,Ad=0.93 -o solution.h5");
  command.add_option("FILE", arguments.project, "project file with [offline]")->required();
  command.add_option("--at", arguments.at, "NAME=VALUE,… for every parameter")->required();
  command.add_option("-o,--output", arguments.output, "file of snapshots to write, of this one point")
      ->required();
  return command;
}

CLI::App& add_command(CLI::App& parent, ReproduceArguments& arguments) {
  CLI::App& command = add_command(
      parent, "reproduce",
      "The published study, figure by figure, compared with its published values (runs a program in Python).",
      "knothe reproduce --quick -o reproduction/\n"
      "writes reproduction/reproduce.html (open it in a browser) and reproduction/reproduce.json;\n"
      "models are kept there and used again. Needs Python: numpy, h5py, knothe.");
  command.add_flag("--quick", arguments.quick,
                   "fewer other choices and repetitions, same figures: minutes, not an hour");
  command.add_flag("--json", arguments.json, "JSON lines on stdout, one per row");
  command.add_option("-o,--output", arguments.output, "folder for page, JSON file and models")
      ->capture_default_str();
  command.add_option("--seed", arguments.seed, "seed of nodes and noise")->capture_default_str();
  return command;
}

}  // namespace knothe
