#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "apps/knothe-offline/commands.hpp"
#include "apps/knothe-offline/problem.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/numerics/sobol.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/reduction/compression.hpp"

namespace knothe::offline_commands {
namespace {

nlohmann::ordered_json errors(const reduction::ModelError& e) {
  return {{"relative_error", e.relative},
          {"relative_error_without_lift", e.relative_to_lift},
          {"max_error_m", e.max}};
}

}  // namespace

int verify(const VerifyArguments& arguments) {
  const project::Project project = project::read_project(arguments.project);
  const mechanics::BeamProblem problem = beam_problem(project);
  const reduction::ModelContents model = reduction::read_model(arguments.model);
  mechanics::FullOrderModel full_order = mechanics::make_full_order_model(problem);
  if (static_cast<std::size_t>(full_order.structure().dof_count()) != model.dof_count() ||
      static_cast<std::size_t>(problem.solver.steps) != model.time.size()) {
    throw DataError(fmt::format(
        "{}: the model has {} dofs and {} steps, the project's full-order model {} and {}: verify a "
        "model with the project file that it was built from",
        arguments.model, model.dof_count(), model.time.size(), full_order.structure().dof_count(),
        problem.solver.steps));
  }
  const auto d = static_cast<Eigen::Index>(model.axes.size());
  const Eigen::MatrixXd points = numerics::sobol_points(arguments.points, d, arguments.seed);
  std::vector<reduction::OffGridSolution> solutions;
  Progress progress("full-order runs", static_cast<std::size_t>(arguments.points), arguments.json);
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    reduction::OffGridSolution solution;
    for (Eigen::Index k = 0; k < d; ++k) {
      const auto& nodes = model.axes[static_cast<std::size_t>(k)].nodes;
      solution.parameters.push_back(nodes.front() + points(i, k) * (nodes.back() - nodes.front()));
    }
    solution.values =
        full_order.run(mechanics::damage_parameters(problem, model.axes, solution.parameters)).displacement;
    const reduction::ModelError error = reduction::off_grid_error(model, {&solution, 1});
    if (arguments.json) {
      nlohmann::ordered_json line = {{"point", solution.parameters}};
      line.update(errors(error));
      fmt::print("{}\n", files::json_line(line));
    } else {
      fmt::print("  ({:.4f})  error {:.2e}, of u − lift {:.2e}, at most {:.3f} µm on any dof\n",
                 fmt::join(solution.parameters, ", "), error.relative, error.relative_to_lift,
                 error.max * 1e6);
    }
    std::fflush(stdout);
    solutions.push_back(std::move(solution));
    progress.advance_to(static_cast<std::size_t>(i) + 1);
  }
  const reduction::ModelError all = reduction::off_grid_error(model, solutions);
  if (arguments.json) {
    nlohmann::ordered_json line = {{"done", true}, {"points", arguments.points}, {"seed", arguments.seed}};
    line.update(errors(all));
    fmt::print("{}\n", files::json_line(line));
  } else {
    fmt::print("{} points: error {:.2e}, of u − lift {:.2e}, at most {:.3f} µm on any dof\n",
               arguments.points, all.relative, all.relative_to_lift, all.max * 1e6);
  }
  return 0;
}

}  // namespace knothe::offline_commands
