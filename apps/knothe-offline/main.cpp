/// @file `knothe-offline`: the command line of the offline phase.
#include <CLI/CLI.hpp>
#include <functional>
#include <string>

#include "apps/guarded_main.hpp"
#include "apps/knothe-offline/commands.hpp"
#include "knothe/base/version.hpp"
#include "knothe/project/offline_options.hpp"

int main(int argc, char** argv) {
  using namespace knothe::offline_commands;
  CLI::App app(
      "The offline phase of knothe: full-order mechanics and reduced models.\n"
      "Usually run by `knothe offline`, `knothe model verify` and `knothe simulate`.",
      "knothe-offline");
  app.set_version_flag("--version", std::string("knothe ") + knothe::k_version);
  app.require_subcommand(1);
  std::function<int()> chosen;

  BuildArguments build;
  CLI::App& offline = *app.add_subcommand("offline", "Builds the reduced model of a project.");
  offline.footer("Example:\n  knothe offline examples/beam/quick.toml -o beam.h5");
  offline.add_option("FILE", build.project, "project file")->required();
  offline.add_option("-o,--output", build.output, "model file to write")->required();
  offline.add_option("--method", build.method, "how: snapshots or latin (default: the project's)")
      ->check(CLI::IsMember(knothe::words_of<knothe::project::OfflineMethod>()));
  offline.add_flag("--json", build.json, "JSON lines on stdout");
  offline.callback([&] { chosen = [&] { return build_model(build); }; });

  VerifyArguments verification;
  CLI::App& verify_command = *app.add_subcommand("verify", "Error of a model against full-order runs.");
  verify_command.footer("Example:\n  knothe model verify beam.toml beam.h5 --points 5 --seed 1");
  verify_command.add_option("FILE", verification.project, "project file with [offline]")->required();
  verify_command.add_option("MODEL", verification.model, "model file")->required();
  verify_command.add_option("--points", verification.points, "number of points")->check(CLI::PositiveNumber);
  verify_command.add_option("--seed", verification.seed, "seed of the points");
  verify_command.add_flag("--json", verification.json, "JSON lines on stdout");
  verify_command.callback([&] { chosen = [&] { return verify(verification); }; });

  MeshStudyArguments study;
  CLI::App& study_command = *app.add_subcommand(
      "mesh-study", "Load, dissipated energy and crack length of the beam on several meshes, by damage law.");
  study_command.footer("Example:\n  knothe model mesh-study examples/beam/beam.toml -o mesh-study.svg");
  study_command.add_option("FILE", study.project, "project file with [offline]")->required();
  study_command.add_option("--elements", study.elements, "element sizes, m, largest first")
      ->delimiter(',')
      ->check(CLI::PositiveNumber);
  study_command.add_option("--laws", study.laws, "regularisations")
      ->delimiter(',')
      ->check(CLI::IsMember(knothe::words_of<knothe::project::DamageRegularisation>()));
  study_command.add_option("--steps", study.steps, "load steps (default: the project's)")
      ->check(CLI::PositiveNumber);
  study_command.add_option("-o,--output", study.output, "figure to write (.svg)");
  study_command.add_flag("--json", study.json, "JSON lines on stdout");
  study_command.callback([&] { chosen = [&] { return mesh_study(study); }; });

  FullOrderArguments full;
  CLI::App& full_command = *app.add_subcommand(
      "full-order", "One run of the full-order model, its mesh distributed over the ranks of an MPI job.");
  full_command.footer(
      "Example:\n  mpirun -np 2 knothe-offline full-order examples/beam/beam.toml --refinements 1 --elastic");
  full_command.add_option("FILE", full.project, "project file with [offline]")->required();
  full_command.add_option("--refinements", full.refinements, "divide each cell into 8, so often (0 to 6)")
      ->capture_default_str();
  full_command.add_option("--steps", full.steps, "load steps (default: the project's)")
      ->check(CLI::PositiveNumber);
  full_command.add_flag("--elastic", full.elastic, "the elastic solution alone");
  full_command
      .add_option("--tolerance", full.tolerance, "of the elastic solution: residual / right-hand side")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  full_command.add_option("--iterations", full.most_iterations, "of conjugate gradients, at most")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  full_command.add_option("-o,--output", full.output, "displacement and damage of the last step (.vtu)");
  full_command.add_flag("--json", full.json, "JSON lines on stdout");
  full_command.callback([&] { chosen = [&] { return full_order(full); }; });

  SimulateArguments simulation;
  CLI::App& simulate_command =
      *app.add_subcommand("simulate", "Synthetic measurements from the full-order model.");
  simulate_command.footer("Example:\n  knothe simulate examples/beam/quick.toml -o data.h5 --seed 1");
  simulate_command.add_option("FILE", simulation.project, "project file")->required();
  simulate_command.add_option("-o,--output", simulation.output, "measurement file to write")->required();
  simulate_command.add_flag("--images", simulation.images, "pictures of the test, into a folder");
  simulate_command.add_option("--seed", simulation.seed, "seed of nodes and noise");
  simulate_command.callback([&] { chosen = [&] { return simulate(simulation); }; });

  ReproduceArguments reproduction;
  CLI::App& reproduce_command =
      *app.add_subcommand("reproduce", "The published study, figure by figure, beside its published values.");
  reproduce_command.footer("Example:\n  knothe reproduce --quick -o reproduction/");
  reproduce_command.add_flag("--quick", reproduction.quick,
                             "fewer other choices and repetitions, same figures");
  reproduce_command.add_flag("--json", reproduction.json, "JSON lines on stdout, one per row");
  reproduce_command.add_option("-o,--output", reproduction.output, "folder for page, JSON file and models")
      ->capture_default_str();
  reproduce_command.add_option("--seed", reproduction.seed, "seed of nodes and noise")->capture_default_str();
  reproduce_command.callback([&] { chosen = [&] { return reproduce(reproduction); }; });

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : static_cast<int>(knothe::ExitStatus::usage);
  }
  return knothe::guarded_main("knothe", chosen);
}
