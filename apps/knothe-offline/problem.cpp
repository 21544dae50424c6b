#include "apps/knothe-offline/problem.hpp"

#include <map>

#include "knothe/base/error.hpp"

namespace knothe::offline_commands {

mechanics::BeamProblem beam_problem(const project::Project& project) {
  project.require(project.offline.has_value(), "a table [offline]");
  const project::OfflineOptions& options = *project.offline;
  mechanics::BeamProblem problem;
  problem.beam.element = options.element;
  problem.beam.layers = options.layers;
  problem.beam.left_support = options.left_support;
  problem.gmsh_file = options.gmsh;
  problem.elastic.young_modulus = options.young_modulus;
  problem.elastic.poisson_ratio = options.poisson_ratio;
  problem.solver.steps = options.steps;
  problem.solver.displacement = options.displacement;
  auto& regularisation = problem.solver.regularisation;
  regularisation.kind = options.regularisation;
  regularisation.reference_size = options.reference_size;
  regularisation.internal_length = options.internal_length;
  for (const project::OfflineParameter& parameter : options.parameters) {
    if (parameter.name == "Y0") problem.reference.threshold = parameter.reference;
    if (parameter.name == "Ad") problem.reference.brittleness = parameter.reference;
    if (parameter.name == "E") problem.elastic.young_modulus = parameter.reference;
    if (parameter.name == "support_stiffness") problem.beam.support_stiffness = parameter.reference;
  }
  return problem;
}

std::vector<reduction::Axis> parameter_axes(const project::Project& project) {
  std::vector<reduction::Axis> axes;
  for (const project::OfflineParameter& parameter : project.offline->parameters) {
    reduction::Axis axis;
    axis.name = parameter.name;
    axis.reference = parameter.reference;
    static const std::map<std::string, std::string> k_names = {
        {"Y0", "damage threshold Y0, multiple of its reference [J/m3]"},
        {"Ad", "brittleness Ad, multiple of its reference [m3/J]"},
        {"E", "Young's modulus, multiple of its reference [Pa]"},
        {"support_stiffness", "stiffness of each support, multiple of its reference [N/m]"},
        {"load_offset", "offset of the load line from mid-span, multiple of its reference [m]"}};
    axis.long_name = k_names.at(parameter.name);
    for (int i = 0; i < parameter.nodes; ++i) {
      axis.nodes.push_back(parameter.lower + (parameter.upper - parameter.lower) * i / (parameter.nodes - 1));
    }
    axes.push_back(std::move(axis));
  }
  return axes;
}

}  // namespace knothe::offline_commands
