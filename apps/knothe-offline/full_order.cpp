#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "apps/knothe-offline/commands.hpp"
#include "knothe/files/command_output.hpp"
#include "knothe/files/vtu.hpp"
#include "knothe/offline/distributed/distributed_model.hpp"
#include "knothe/offline/distributed/ranks.hpp"
#include "knothe/offline/problem.hpp"

namespace knothe::offline_commands {
namespace {

using offline::DistributedElastic;
using offline::StepRecord;

void report(const DistributedElastic& elastic, const files::CommandOutput& output) {
  output.line(
      {{"dofs", elastic.dofs},
       {"cells", elastic.cells},
       {"ranks", elastic.ranks},
       {"iterations", elastic.iterations},
       {"residual", elastic.residual},
       {"stiffness_N_per_m", elastic.unit_reaction},
       {"set_up_seconds", elastic.set_up_seconds},
       {"solve_seconds", elastic.solve_seconds},
       {"memory_MiB", elastic.memory_of_all},
       {"largest_memory_MiB", elastic.largest_memory}},
      fmt::format("{} dofs, {} cells, {} rank{}\nelastic solution: {} iterations, residual {:.1e}; {:.1f} s "
                  "to set up, {:.1f} s to solve; {:.0f} MiB ({:.0f} on one rank)\nstiffness {:.4f} kN/mm",
                  elastic.dofs, elastic.cells, elastic.ranks, elastic.ranks == 1 ? "" : "s",
                  elastic.iterations, elastic.residual, elastic.set_up_seconds, elastic.solve_seconds,
                  elastic.memory_of_all, elastic.largest_memory, 1e-6 * elastic.unit_reaction));
}

void report(int number, const StepRecord& step, const files::CommandOutput& output) {
  output.line(
      {{"step", number},
       {"displacement_m", step.imposed_displacement},
       {"force_N", step.reaction_force},
       {"crack_mouth_opening_m", step.crack_mouth_opening},
       {"dissipated_J", step.dissipated_energy},
       {"newton_iterations", step.newton_iterations},
       {"secant_iterations", step.secant_iterations},
       {"equilibrium", step.equilibrium},
       {"residual", step.residual}},
      fmt::format("step {:3}: {:.4f} mm, {:8.1f} N, opening {:8.4f} mm, {:2} Newton + {} secant iterations{}",
                  number, 1e3 * step.imposed_displacement, step.reaction_force,
                  1e3 * step.crack_mouth_opening, step.newton_iterations, step.secant_iterations,
                  step.equilibrium ? "" : ", not in equilibrium"));
}

/// Displacement, and damage if there is any, for ParaView.
void write_field(const offline::HexahedronMesh& mesh, std::span<const double> displacement,
                 const std::vector<double>& damage, const std::string& path) {
  files::VtuGrid grid;
  grid.points = mesh.points;
  grid.cells = mesh.cells;
  grid.point_fields.push_back({"displacement", 3, {displacement.begin(), displacement.end()}, "m"});
  if (!damage.empty()) grid.cell_fields.push_back({"damage", 1, damage, "1"});
  grid.time = 1.0;  // the model time of the last step
  files::write_vtu(grid, path);
}

void run(const FullOrderArguments& arguments) {
  const bool first = offline::Ranks::start().rank == 0;
  const files::CommandOutput output(arguments.json);
  offline::BeamProblem problem = offline::beam_problem(project::read_project(arguments.project));
  if (arguments.steps > 0) problem.solver.steps = arguments.steps;
  const offline::HexahedronMesh mesh = offline::make_mesh(problem);
  offline::DistributedModel model(
      mesh, problem.elastic, problem.solver, arguments.refinements,
      {.tolerance = arguments.tolerance, .max_iterations = arguments.max_iterations});
  if (first) report(model.elastic(), output);
  std::vector<double> field = model.elastic().unit_lift, damage;
  if (arguments.elastic) {
    for (double& u : field) u *= problem.solver.displacement;
  } else {
    offline::FullOrderResult result = model.run(problem.reference, [&](int step, const StepRecord& record) {
      if (first) report(step, record, output);
    });
    if (first)
      output.line({{"done", true},
                   {"crack_length_m", result.crack_length},
                   {"steps_without_equilibrium", result.steps_without_equilibrium()},
                   {"cpu_seconds", result.cpu_seconds}},
                  fmt::format("crack {:.1f} mm above the notch; {:.1f} s of CPU on all ranks",
                              1e3 * result.crack_length, result.cpu_seconds));
    field.assign(result.displacement.end() - std::ssize(field), result.displacement.end());
    damage = std::move(result.cell_damage);
  }
  if (first && !arguments.output.empty()) write_field(mesh, field, damage, arguments.output);
}

}  // namespace

int full_order(const FullOrderArguments& arguments) {
  run(arguments);
  offline::Ranks::finish();  // nothing that lives on the ranks is left
  return 0;
}

}  // namespace knothe::offline_commands
