#include <fmt/format.h>

#include "apps/knothe-offline/commands.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/project/picture_simulation.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/simulation.hpp"

namespace knothe::offline_commands {

int simulate(const SimulateArguments& arguments) {
  const project::Project project = project::read_project(arguments.project);
  const mechanics::BeamProblem problem = offline::beam_problem(project);
  const std::vector<reduction::Axis> axes = offline::parameter_axes(project);
  std::vector<std::string> names;
  for (const reduction::Axis& axis : axes) names.push_back(axis.name);
  const std::vector<double> truth = project::simulated_truth(project, names);
  mechanics::FullOrderModel model = mechanics::make_full_order_model(problem);
  const mechanics::FullOrderResult run = mechanics::run_at(model, problem, axes, truth);
  const std::size_t n_dof = model.structure().dof_count();
  const auto field = [&](std::size_t step, std::span<const std::size_t> dofs) {
    std::vector<double> values;
    for (std::size_t dof : dofs) values.push_back(run.displacement[step * n_dof + dof]);
    return values;
  };
  const auto& mesh = model.structure().mesh();
  const std::vector<double> time = mechanics::model_time(problem.solver);
  if (arguments.images)
    project::simulate_pictures(project, mechanics::mesh_of(mesh), mechanics::dofs(mesh), time, field,
                               arguments.seed, arguments.output);
  else
    project::simulate_measurements(project, mechanics::dofs(mesh), time, field, arguments.seed,
                                   arguments.output);
  return 0;
}

}  // namespace knothe::offline_commands
