#include "knothe/project/update_setup.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/assimilation/time_matching.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/reduction/parameter_order.hpp"

namespace knothe::project {
namespace {

void check_parameters(const Project& project, const std::vector<std::string>& model_names) {
  std::vector<std::string> names;
  for (const NamedPrior& parameter : project.parameters) names.push_back(parameter.name);
  for (const std::string& name : names) {
    if (std::find(model_names.begin(), model_names.end(), name) == model_names.end()) {
      throw ProjectError(fmt::format(
          "{}: error: parameters.{} is not a parameter of the model {}{}; it has {}", project.path, name,
          project.model, did_you_mean(name, model_names), fmt::join(model_names, ", ")));
    }
  }
  for (const std::string& name : model_names) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw ProjectError(
          fmt::format("{}: error: [parameters] lacks a prior for \"{}\", a parameter of the model {}",
                      project.path, name, project.model));
    }
  }
}

assimilation::UpdateOptions update_options(const MethodOptions& method) {
  assimilation::UpdateOptions options;
  options.kind = method.kind == "grid" ? assimilation::UpdateOptions::Kind::grid
                                       : assimilation::UpdateOptions::Kind::transport;
  options.form = method.form == "composed" ? assimilation::UpdateOptions::Form::composed
                                           : assimilation::UpdateOptions::Form::collapsed;
  options.map.tolerance = method.tolerance;
  options.map.max_order = method.max_order;
  options.map.seed = method.seed;
  options.map.minimiser = method.minimiser == "bfgs"          ? transport::MinimiserKind::bfgs
                          : method.minimiser == "nelder-mead" ? transport::MinimiserKind::nelder_mead
                                                              : transport::MinimiserKind::newton;
  return options;
}

}  // namespace

UpdateSetup set_up(const Project& project) {
  project.require(!project.model.empty(), "a model: `model = \"MODEL.h5\"`");
  project.require(!project.data.empty(), "data: `data = \"DATA.h5\"`");
  project.require(!project.parameters.empty(),
                  "a table [parameters] with a prior for each parameter of the model");
  const auto stored = reduction::SeparatedModel::load(project.model);
  check_parameters(project, stored.parameter_names());
  std::vector<std::string> names;
  std::vector<assimilation::Prior> priors;
  for (const NamedPrior& parameter : project.parameters) {
    names.push_back(parameter.name);
    priors.push_back(parameter.prior);
  }
  const reduction::SeparatedModel model(reduction::with_parameter_order(stored.contents(), names),
                                        project.model);
  assimilation::Measurements measurements = assimilation::read_measurements(project.data);
  std::vector<double> points;
  for (Eigen::Index j = 0; j < measurements.points.rows(); ++j) {
    for (Eigen::Index c = 0; c < 3; ++c) points.push_back(measurements.points(j, c));
  }
  const std::vector<std::int64_t> components(measurements.components.begin(), measurements.components.end());
  auto observed =
      std::make_shared<const reduction::ObservedModel>(reduction::observe(model, points, components));
  std::vector<std::size_t> times = assimilation::match_times(measurements.time, observed->time, project.data);
  return {model,
          std::move(measurements),
          std::move(points),
          components,
          std::move(observed),
          std::move(times),
          std::move(priors),
          update_options(project.method)};
}

}  // namespace knothe::project
