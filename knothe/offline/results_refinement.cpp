#include "knothe/offline/results_refinement.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/base/index.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/model/grid/local_refinement.hpp"
#include "knothe/model/reduced/parameter_order.hpp"
#include "knothe/model/simulator/kept_solutions.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/project/refinement.hpp"
#include "knothe/record/results.hpp"

namespace knothe::offline {
namespace {

/// The solutions at `points`, and those that the folder has of other points.
std::vector<model::Snapshots> solutions_at(model::Simulator& simulator,
                                           const std::vector<std::vector<double>>& points,
                                           const std::string& folder) {
  std::filesystem::create_directories(folder);
  Progress progress("full-order runs at the posterior", points.size());
  for (Index i = 0; i < std::ssize(points); ++i) {
    const std::string file = model::solution_file(folder, simulator.key(points[i]));
    if (!std::filesystem::exists(file)) model::write_snapshots(simulator.solve(points[i]), file);
    progress.advance_to(i + 1);
  }
  return model::kept_solutions(simulator, folder);
}

}  // namespace

void refine_model(const RefineOptions& options, const files::CommandOutput& output) {
  const project::Project project = project::read_project(options.project);
  project.require(!project.model.empty(), "a model to refine: `model = \"MODEL.h5\"`");
  const record::Results results = record::read_results(options.results);
  std::vector<std::string> names;
  for (const record::ParameterSummary& parameter : results.parameters) names.push_back(parameter.name);
  const model::ModelContents base = model::with_parameter_order(model::read_model(project.model), names);
  const record::Step& last = results.steps.back();
  const auto simulator = project_simulator(project, base.axes);
  const std::vector<model::Snapshots> solutions = solutions_at(
      *simulator, project::points_around(last.mean, last.covariance, base.axes), options.model + ".parts");
  const model::RefinedModel fine = model::refined(base, model::read_truncation_error(project.model),
                                                  solutions, {last.mean, last.covariance});
  model::write_model(fine.model, fine.error, options.model);
  output.line({{"done", true}, {"model", options.model}, {"full_order_runs", solutions.size()}},
              fmt::format("{}: {} refined by {} full-order solutions around the posterior of step {}",
                          options.model, project.model, solutions.size(), last.step));
}

}  // namespace knothe::offline
