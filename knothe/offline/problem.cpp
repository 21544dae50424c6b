#include "knothe/offline/problem.hpp"

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"

namespace knothe::offline {

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
  problem.solver.regularisation = {options.regularisation, options.reference_size, options.internal_length};
  for (const project::OfflineParameter& parameter : options.parameters) {
    if (parameter.name == "Y0") problem.reference.threshold = parameter.reference;
    if (parameter.name == "Ad") problem.reference.brittleness = parameter.reference;
    if (parameter.name == "E") problem.elastic.young_modulus = parameter.reference;
    if (parameter.name == "support_stiffness") problem.beam.support_stiffness = parameter.reference;
  }
  return problem;
}

std::vector<reduction::Axis> parameter_axes(const project::Project& project) {
  project.require(project.offline.has_value(), "a table [offline]");
  std::vector<reduction::Axis> axes;
  for (const project::OfflineParameter& p : project.offline->parameters)
    axes.push_back(mechanics::parameter_axis(p.name, p.reference, p.lower, p.upper, p.nodes));
  return axes;
}

std::vector<std::string> parameter_names(const project::Project& project) {
  project.require(project.offline.has_value(), "a table [offline]");
  std::vector<std::string> names;
  for (const project::OfflineParameter& p : project.offline->parameters) names.push_back(p.name);
  return names;
}

std::vector<std::vector<double>> points_in_box(const std::vector<reduction::Axis>& axes, int count,
                                               std::uint64_t seed) {
  const Eigen::MatrixXd unit = numerics::sobol_points(count, static_cast<Eigen::Index>(axes.size()), seed);
  std::vector<std::vector<double>> points(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t k = 0; k < axes.size(); ++k) {
      const std::vector<double>& nodes = axes[k].nodes;
      points[i].push_back(nodes.front() + unit(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) *
                                              (nodes.back() - nodes.front()));
    }
  return points;
}

std::unique_ptr<simulator::Simulator> project_simulator(const project::Project& project,
                                                        std::vector<reduction::Axis> axes) {
  return std::make_unique<mechanics::BeamSimulator>(beam_problem(project), std::move(axes));
}

}  // namespace knothe::offline
