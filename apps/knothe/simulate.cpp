#include "knothe/likelihood/data/synthetic_measurements.hpp"

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/project/picture_simulation.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/simulation.hpp"

namespace knothe::commands {

int simulate(const SimulateArguments& arguments) {
  files::refuse_overwriting(arguments.output, {arguments.project, arguments.model});
  if (arguments.model.empty()) {
    std::vector<std::string> words = {"simulate", arguments.project, "-o", arguments.output};
    if (arguments.seed) words.insert(words.end(), {"--seed", std::to_string(*arguments.seed)});
    if (arguments.images) words.emplace_back("--images");
    return run_sibling(words);
  }
  const project::Project project = project::read_project(arguments.project);
  const auto model = model::SeparatedModel::load(arguments.model);
  const std::vector<double> truth = project::simulated_truth(project, model.parameter_names());
  const auto field = [&](std::size_t step, std::span<const std::size_t> dofs) {
    return model.evaluate(truth, step, dofs).value;
  };
  const auto& contents = model.contents();
  project::SimulatedField simulated = {contents.dofs, contents.quantities, contents.time, field, {}};
  for (const model::SnapshotOutput& output : contents.outputs)
    simulated.outputs.push_back(
        {output.name, output.labels, model.evaluate_output(output.name, truth).value});
  if (arguments.images) {
    if (!contents.mesh)
      throw DataError(arguments.model + ": the model has no mesh: no picture can be drawn of it");
    project::simulate_pictures(project, *contents.mesh, simulated, arguments.seed, arguments.output);
  } else {
    project::simulate_measurements(project, simulated, arguments.seed, arguments.output);
  }
  return 0;
}

}  // namespace knothe::commands
