#include "knothe/offline/problem.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/simulator/command_simulator.hpp"
#include "knothe/model/simulator/resampled_simulator.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/offline/umbridge_simulator.hpp"

namespace knothe::offline {

BeamProblem beam_problem(const project::Project& project) {
  project.require(project.offline.has_value(), "a table [offline]");
  const project::OfflineOptions& options = *project.offline;
  if (!options.is_beam())
    throw ProjectError("this is for the built-in beam, and the project has another solver");
  BeamProblem problem;
  problem.beam.element = options.element;
  problem.beam.layers = options.layers;
  problem.beam.left_support = options.left_support;
  problem.gmsh_file = options.gmsh;
  problem.elastic.young_modulus = options.young_modulus;
  problem.elastic.poisson_ratio = options.poisson_ratio;
  problem.solver.steps = options.steps;
  problem.solver.displacement = options.displacement;
  problem.solver.regularisation = {options.regularisation, options.reference_size, options.internal_length};
  problem.reference.law = options.law;
  for (const project::OfflineParameter& parameter : options.parameters) {
    if (parameter.name == "Y0") problem.reference.threshold = parameter.reference;
    if (parameter.name == "Ad") problem.reference.brittleness = parameter.reference;
    if (parameter.name == "Gf")
      problem.reference.brittleness = brittleness_of(parameter.reference, options.reference_size);
    if (parameter.name == "E") problem.elastic.young_modulus = parameter.reference;
    if (parameter.name == "support_stiffness") problem.beam.support_stiffness = parameter.reference;
  }
  return problem;
}

namespace {

/// The axis of a parameter of another program.
model::Axis own_axis(const project::OfflineParameter& p) {
  model::Axis axis;
  axis.name = p.name;
  axis.reference = p.reference;
  axis.units = p.units.empty() || p.reference != 1 ? "1" : p.units;
  axis.long_name = p.long_name;
  if (p.reference != 1)
    axis.long_name +=
        fmt::format("{}multiple of {:g} {}", p.long_name.empty() ? "" : ", ", p.reference, p.units);
  for (int i = 0; i < p.nodes; ++i) axis.nodes.push_back(p.lower + (p.upper - p.lower) * i / (p.nodes - 1));
  return axis;
}

}  // namespace

std::vector<model::Axis> parameter_axes(const project::Project& project) {
  project.require(project.offline.has_value(), "a table [offline]");
  std::vector<model::Axis> axes;
  for (const project::OfflineParameter& p : project.offline->parameters)
    axes.push_back(!project.offline->is_beam()
                       ? own_axis(p)
                       : parameter_axis(p.name, p.reference, p.lower, p.upper, p.nodes));
  return axes;
}

std::vector<std::string> parameter_names(const project::Project& project) {
  project.require(project.offline.has_value(), "a table [offline]");
  std::vector<std::string> names;
  for (const project::OfflineParameter& p : project.offline->parameters) names.push_back(p.name);
  return names;
}

std::vector<std::vector<double>> points_in_box(const std::vector<model::Axis>& axes, int count,
                                               std::uint64_t seed) {
  const Eigen::MatrixXd unit = numerics::sobol_points(count, std::ssize(axes), seed);
  std::vector<std::vector<double>> points(count);
  for (Index i = 0; i < std::ssize(points); ++i)
    for (Index k = 0; k < std::ssize(axes); ++k) {
      const std::vector<double>& nodes = axes[k].nodes;
      points[i].push_back(nodes.front() + unit(i, k) * (nodes.back() - nodes.front()));
    }
  return points;
}

std::unique_ptr<model::Simulator> project_simulator(const project::Project& project,
                                                    std::vector<model::Axis> axes) {
  project.require(project.offline.has_value(), "a table [offline]");
  std::unique_ptr<model::Simulator> solver;
  if (project.offline->command)
    solver = std::make_unique<model::CommandSimulator>(*project.offline->command, std::move(axes));
  else if (project.offline->umbridge)
    solver = std::make_unique<UmbridgeSimulator>(*project.offline->umbridge, std::move(axes));
  else
    solver = std::make_unique<BeamSimulator>(beam_problem(project), std::move(axes));
  const model::TimeAxis& time = project.offline->time;
  if (time.output.empty()) return solver;
  return std::make_unique<model::ResampledSimulator>(std::move(solver), time);
}

}  // namespace knothe::offline
