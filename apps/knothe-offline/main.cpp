/// @file `knothe-offline`: the command line of the offline phase.
#include "apps/guarded_main.hpp"
#include "apps/knothe-offline/commands.hpp"
#include "knothe/base/version.hpp"
#include "knothe/model/reduced/parameter_order.hpp"
#include "knothe/offline/mesh_study.hpp"
#include "knothe/offline/model_building.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/offline/results_refinement.hpp"
#include "knothe/offline/verification.hpp"

namespace {

using namespace knothe;
using files::CommandOutput;

int offline_build(const BuildArguments& a) {
  if (!a.refine.empty()) {
    offline::refine_model({a.project, a.refine, a.output}, CommandOutput(a.json));
    return 0;
  }
  offline::build_model({a.project, a.output, a.method, a.study, a.share}, CommandOutput(a.json));
  return 0;
}

int verify(const VerifyArguments& a) {
  offline::verify_model({a.project, a.model, a.points, a.seed}, CommandOutput(a.json));
  return 0;
}

int mesh_study(const MeshStudyArguments& a) {
  std::vector<project::DamageRegularisation> laws;
  for (const std::string& law : a.laws) laws.push_back(*from_text<project::DamageRegularisation>(law));
  offline::study_meshes({a.project, a.elements, laws, a.steps, a.output}, CommandOutput(a.json));
  return 0;
}

int solve(const SolveArguments& a) {
  const project::Project project = project::read_project(a.project);
  const std::vector<double> point = model::point_at(a.at, offline::parameter_names(project));
  const auto simulator = offline::project_simulator(project, offline::parameter_axes(project));
  model::write_snapshots(simulator->solve(point), a.output);
  return 0;
}

/// `run` is what the command that reads these arguments does.
template <typename Arguments>
CLI::App& add(CLI::App& app, Command& chosen, Arguments& arguments, int (*run)(const Arguments&)) {
  CLI::App& command = add_command(app, arguments);
  command.callback([&chosen, &arguments, run] { chosen = [&arguments, run] { return run(arguments); }; });
  return command;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app(
      "The offline phase of knothe: full-order mechanics and reduced models.\n"
      "Usually run by `knothe offline`, `knothe model verify` and `knothe simulate`.",
      "knothe-offline");
  app.set_version_flag("--version", std::string("knothe ") + k_version);
  app.require_subcommand(1);
  Command chosen;
  BuildArguments build;
  VerifyArguments verification;
  MeshStudyArguments meshes;
  FullOrderArguments full;
  SolveArguments solution;
  ReproduceArguments reproduction;
  add(app, chosen, build, offline_build);
  add(app, chosen, verification, verify);
  add(app, chosen, meshes, mesh_study);
  add(app, chosen, full, offline_commands::full_order);
  add(app, chosen, solution, solve);
  add(app, chosen, reproduction, offline_commands::reproduce);

  offline_commands::FullOrderDataArguments simulation;
  CLI::App& simulate = add_command(app, "simulate", "Synthetic measurements from the full-order model.",
                                   "knothe simulate examples/beam/quick.toml -o data.h5 --seed 1");
  simulate.add_option("FILE", simulation.project, "project file")->required();
  simulate.add_option("-o,--output", simulation.output, "measurement file to write")->required();
  simulate.add_flag("--images", simulation.images, "pictures of the test, into a folder");
  simulate.add_option("--seed", simulation.seed, "seed of nodes and noise");
  simulate.callback([&] { chosen = [&] { return offline_commands::simulate(simulation); }; });

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : static_cast<int>(ExitStatus::usage);
  }
  return guarded_main("knothe", chosen);
}
