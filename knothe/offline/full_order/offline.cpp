#include "knothe/offline/full_order/offline.hpp"

#include <fmt/format.h>

#include <map>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/offline/mesh/gmsh_mesh.hpp"

namespace knothe::offline {

HexahedronMesh make_mesh(const BeamProblem& problem) {
  return problem.gmsh_file.empty() ? beam_mesh(problem.beam)
                                   : read_gmsh_mesh(problem.gmsh_file, problem.beam.left_support);
}

FullOrderModel make_full_order_model(const BeamProblem& problem) {
  problem.solver.validate();
  const std::string source = problem.gmsh_file.empty() ? "beam" : problem.gmsh_file;
  return FullOrderModel(std::make_shared<const Structure>(make_mesh(problem), problem.elastic, source),
                        problem.solver);
}

model::Axis parameter_axis(const std::string& name, double reference, double lower, double upper, int nodes) {
  static const std::map<std::string, std::string> k_names = {
      {"Y0", "damage threshold Y0, multiple of its reference [J/m3]"},
      {"Ad", "brittleness Ad, multiple of its reference [m3/J]"},
      {"Gf", "fracture energy Gf, multiple of its reference [J/m2]"},
      {"E", "Young's modulus, multiple of its reference [Pa]"},
      {"support_stiffness", "stiffness of each support, multiple of its reference [N/m]"},
      {"load_offset", "offset of the load line from mid-span, multiple of its reference [m]"}};
  model::Axis axis;
  axis.name = name;
  axis.reference = reference;
  axis.long_name = k_names.at(name);
  for (int i = 0; i < nodes; ++i) axis.nodes.push_back(lower + (upper - lower) * i / (nodes - 1));
  return axis;
}

BeamProblem problem_at(const BeamProblem& problem, std::span<const model::Axis> axes,
                       std::span<const double> values) {
  if (axes.size() != values.size())
    throw UsageError(
        fmt::format("{} parameter values were given for {} parameters", values.size(), axes.size()));
  BeamProblem result = problem;
  for (Index i = 0; i < std::ssize(axes); ++i) {
    const std::string& name = axes[i].name;
    const double value = values[i] * axes[i].reference;
    if (name == "Y0") {
      result.reference.threshold = value;
    } else if (name == "Ad") {
      result.reference.brittleness = value;
    } else if (name == "Gf") {
      result.reference.brittleness = brittleness_of(value, problem.solver.regularisation.reference_size);
    } else if (name == "E") {
      result.elastic.young_modulus = value;
    } else if (name == "support_stiffness" || name == "load_offset") {
      if (!problem.gmsh_file.empty())
        throw ProjectError(fmt::format("parameter {}: it is one of the structured beam, not of {}", name,
                                       problem.gmsh_file));
      (name == "load_offset" ? result.beam.load_offset : result.beam.support_stiffness) = value;
    } else {
      const std::vector<std::string> known = {"Y0", "Ad", "Gf", "E", "support_stiffness", "load_offset"};
      throw ProjectError(
          fmt::format("the full-order model has no parameter \"{}\"{}; it has Y0 (threshold, J/m3), Ad "
                      "(brittleness, m3/J) or Gf (fracture energy, J/m2), E (Young's modulus, Pa), "
                      "support_stiffness (N/m) and load_offset (m)",
                      name, did_you_mean(name, known)));
    }
  }
  result.reference.validate();
  result.elastic.validate();
  if (result.gmsh_file.empty()) result.beam.validate();
  return result;
}

bool same_body(const BeamProblem& one, const BeamProblem& other) {
  return one.elastic.young_modulus == other.elastic.young_modulus &&
         one.beam.support_stiffness == other.beam.support_stiffness &&
         one.beam.load_offset == other.beam.load_offset;
}

FullOrderResult run_at(FullOrderModel& model, const BeamProblem& problem, std::span<const model::Axis> axes,
                       std::span<const double> values) {
  const BeamProblem point = problem_at(problem, axes, values);
  return same_body(problem, point) ? model.run(point.reference)
                                   : make_full_order_model(point).run(point.reference);
}

DamageParameters damage_parameters(const BeamProblem& problem, std::span<const model::Axis> axes,
                                   std::span<const double> values) {
  const BeamProblem point = problem_at(problem, axes, values);
  if (!same_body(problem, point))
    throw ProjectError(
        "LATIN-PGD solves for Y0 and Ad, on one elastic body: other parameters take method = \"snapshots\"");
  return point.reference;
}

std::vector<double> model_time(const SolverOptions& solver) {
  std::vector<double> time(solver.steps);
  for (int i = 0; i < solver.steps; ++i) time[i] = (i + 1.0) / solver.steps;
  return time;
}

model::Dofs dofs(const HexahedronMesh& mesh) {
  model::Dofs result;
  for (std::int64_t node = 0; node < mesh.node_count(); ++node)
    for (std::int64_t component = 0; component < 3; ++component) {
      result.points.insert(result.points.end(), &mesh.points[3 * node], &mesh.points[3 * node] + 3);
      result.components.push_back(component);
    }
  return result;
}

model::Mesh mesh_of(const HexahedronMesh& mesh) {
  model::Mesh result;
  result.points = mesh.points;
  result.cells = mesh.cells;
  return result;
}

std::vector<double> elastic_lift(const Structure& structure, const SolverOptions& solver) {
  std::vector<double> lift;
  lift.reserve(static_cast<std::size_t>(solver.steps) * structure.dof_count());
  for (int i = 0; i < solver.steps; ++i) {
    const double imposed = solver.displacement * (i + 1) / solver.steps;
    for (const double value : structure.unit_lift()) lift.push_back(imposed * value);
  }
  return lift;
}

model::Snapshots as_snapshots(const BeamProblem& problem, const Structure& structure,
                              const FullOrderResult& result) {
  model::Snapshots snapshots;
  snapshots.time = model_time(problem.solver);
  snapshots.values = result.displacement;
  snapshots.dofs = dofs(structure.mesh());
  snapshots.lift = elastic_lift(structure, problem.solver);
  snapshots.mesh = mesh_of(structure.mesh());
  snapshots.outputs = {
      {"reaction_force", {"N", "reaction force of the whole beam"}, {}},
      {"crack_mouth_opening", {"m", "relative displacement u_x of the notch's lower corners"}, {}},
      {"imposed_displacement", {"m", "imposed downward displacement of the load strip"}, {}},
      {"equilibrium_residual", {"1", "out-of-balance nodal forces / reaction force"}, {}}};
  for (const auto& step : result.steps) {
    snapshots.outputs[0].values.push_back(step.reaction_force);
    snapshots.outputs[1].values.push_back(step.crack_mouth_opening);
    snapshots.outputs[2].values.push_back(step.imposed_displacement);
    snapshots.outputs[3].values.push_back(step.residual);
  }
  return snapshots;
}

CrackTable crack_table(const BeamProblem& problem, const CrackedBeamOptions& options,
                       const model::Dofs& dofs) {
  const CrackedBeam cracked(problem.beam, options, problem.elastic);
  CrackTable table;
  table.lengths.assign(cracked.lengths().begin(), cracked.lengths().end());
  table.stiffness.assign(cracked.stiffness().begin(), cracked.stiffness().end());
  table.values = cracked.interpolate(dofs.points, dofs.components);
  return table;
}

namespace {

/// Counts up whenever the same options give other results: runs of an older program are then not taken for
/// new ones.
constexpr int k_results_version = 1;

}  // namespace

std::string run_key(const BeamProblem& problem) {
  const DamageParameters& p = problem.reference;
  const auto& beam = problem.beam;
  const auto& solver = problem.solver;
  std::string mesh;
  if (problem.gmsh_file.empty())
    mesh =
        fmt::format("beam {:a} {} {:a} {:a} {:a} {:a} {:a} {:a} {:a} {:a} {:a} {:a} {:a} {:a}", beam.element,
                    beam.layers, beam.length, beam.height, beam.half_thickness, beam.notch_depth,
                    beam.notch_width, beam.support, beam.load_half_width, beam.refined_half_width,
                    beam.protected_half_width, beam.protected_depth, beam.growth, beam.largest_element);
  else
    mesh = fmt::format("gmsh {:016x}", fnv1a(files::read_text(problem.gmsh_file)));
  if (beam.support_stiffness != 0 || beam.load_offset != 0)
    mesh += fmt::format(" | springs {:a} offset {:a}", beam.support_stiffness, beam.load_offset);
  const auto& regularisation = solver.regularisation;
  std::string law;
  if (regularisation.kind == DamageRegularisation::crack_band)
    law = fmt::format(" | crack band {:a}", regularisation.reference_size);
  else if (regularisation.kind == DamageRegularisation::gradient)
    law = fmt::format(" | gradient {:a}", regularisation.internal_length);
  if (p.law != SofteningLaw::brittle) law += fmt::format(" | {}", to_text(p.law));
  return fmt::format(
      "version {} | {} | left {} | E {:a} nu {:a} | Y0 {:a} Ad {:a} | {} steps {:a} m | tolerance {:a} {:a} "
      "| {} {} {} {:a} {}{}",
      k_results_version, mesh, static_cast<int>(beam.left_support), problem.elastic.young_modulus,
      problem.elastic.poisson_ratio, p.threshold, p.brittleness, solver.steps, solver.displacement,
      solver.tolerance, solver.acceptance, solver.newton_iterations, solver.cuts, solver.secant_iterations,
      solver.activation, static_cast<int>(solver.condensation), law);
}

}  // namespace knothe::offline
