#include "knothe/assimilation/synthetic_measurements.hpp"

#include <fmt/format.h>

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/simulation.hpp"
#include "knothe/reduction/separated_model.hpp"

namespace knothe::commands {

int simulate(const SimulateArguments& arguments) {
  if (arguments.model.empty()) {
    std::vector<std::string> words = {"simulate", arguments.project, "-o", arguments.output};
    if (arguments.seed) words.insert(words.end(), {"--seed", std::to_string(*arguments.seed)});
    return run_sibling(words);
  }
  const project::Project project = project::read_project(arguments.project);
  const auto model = reduction::SeparatedModel::load(arguments.model);
  const std::vector<double> truth = project::simulated_truth(project, model.parameter_names());
  project::simulate_measurements(
      project, model.contents().dofs, model.contents().time,
      [&](std::size_t step, std::span<const std::size_t> dofs) {
        return model.evaluate(truth, step, dofs).value;
      },
      arguments.seed, arguments.output);
  return 0;
}

}  // namespace knothe::commands
