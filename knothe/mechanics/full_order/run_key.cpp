#include "knothe/mechanics/full_order/run_key.hpp"

#include <fmt/format.h>

#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::mechanics {
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
  if (p.law == SofteningLaw::exponential) law += " | exponential";
  return fmt::format(
      "version {} | {} | left {} | E {:a} nu {:a} | Y0 {:a} Ad {:a} | {} steps {:a} m | tolerance {:a} {:a} "
      "| {} {} {} {:a} {}{}",
      k_results_version, mesh, static_cast<int>(beam.left_support), problem.elastic.young_modulus,
      problem.elastic.poisson_ratio, p.threshold, p.brittleness, solver.steps, solver.displacement,
      solver.tolerance, solver.acceptance, solver.newton_iterations, solver.cuts, solver.secant_iterations,
      solver.activation, static_cast<int>(solver.condensation), law);
}

}  // namespace knothe::mechanics
