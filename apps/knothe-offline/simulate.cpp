#include <fmt/format.h>

#include <cstdio>

#include "apps/knothe-offline/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/project/picture_simulation.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/simulation.hpp"

namespace knothe::offline_commands {

int simulate(const FullOrderDataArguments& arguments) {
  const project::Project project = project::read_project(arguments.project);
  const model::Snapshots solution =
      offline::project_simulator(project, offline::parameter_axes(project))
          ->solve(project::simulated_truth(project, offline::parameter_names(project)));
  for (const std::string& warning : project::truth_outside_box(project))
    fmt::print(stderr, "warning: {}\n", warning);
  const std::size_t n_dof = solution.dof_count();
  const auto field = [&](std::size_t step, std::span<const std::size_t> dofs) {
    std::vector<double> values;
    for (std::size_t dof : dofs) values.push_back(solution.values[step * n_dof + dof]);
    return values;
  };
  if (arguments.images && !solution.mesh)
    throw DataError("the full-order model has no mesh: no picture can be drawn of it");
  const project::SimulatedField simulated = {solution.dofs, solution.quantities, solution.time, field,
                                             solution.outputs};
  if (arguments.images)
    project::simulate_pictures(project, *solution.mesh, simulated, arguments.seed, arguments.output);
  else
    project::simulate_measurements(project, simulated, arguments.seed, arguments.output);
  return 0;
}

}  // namespace knothe::offline_commands
