#include "knothe/offline/results_refinement.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/base/index.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/project/refinement.hpp"
#include "knothe/reduction/grid/local_refinement.hpp"
#include "knothe/reduction/model/parameter_order.hpp"
#include "knothe/report/results/results.hpp"
#include "knothe/simulator/kept_solutions.hpp"

namespace knothe::offline {
namespace {

/// The solutions at `points`, and those that the folder has of other points.
std::vector<reduction::Snapshots> solutions_at(simulator::Simulator& simulator,
                                               const std::vector<std::vector<double>>& points,
                                               const std::string& folder) {
  std::filesystem::create_directories(folder);
  Progress progress("full-order runs at the posterior", points.size());
  for (Index i = 0; i < std::ssize(points); ++i) {
    const std::string file = simulator::solution_file(folder, simulator.key(points[i]));
    if (!std::filesystem::exists(file)) reduction::write_snapshots(simulator.solve(points[i]), file);
    progress.advance_to(i + 1);
  }
  return simulator::kept_solutions(simulator, folder);
}

}  // namespace

void refine_model(const RefineOptions& options, const files::CommandOutput& output) {
  const project::Project project = project::read_project(options.project);
  project.require(!project.model.empty(), "a model to refine: `model = \"MODEL.h5\"`");
  const report::Results results = report::read_results(options.results);
  std::vector<std::string> names;
  for (const report::ParameterSummary& parameter : results.parameters) names.push_back(parameter.name);
  const reduction::ModelContents base =
      reduction::with_parameter_order(reduction::read_model(project.model), names);
  const report::Step& last = results.steps.back();
  const auto simulator = project_simulator(project, base.axes);
  const std::vector<reduction::Snapshots> solutions = solutions_at(
      *simulator, project::points_around(last.mean, last.covariance, base.axes), options.model + ".parts");
  const reduction::RefinedModel fine = reduction::refined(
      base, reduction::read_truncation_error(project.model), solutions, {last.mean, last.covariance});
  reduction::write_model(fine.model, fine.error, options.model);
  output.line({{"done", true}, {"model", options.model}, {"full_order_runs", solutions.size()}},
              fmt::format("{}: {} refined by {} full-order solutions around the posterior of step {}",
                          options.model, project.model, solutions.size(), last.step));
}

}  // namespace knothe::offline
