/// Mesh and step-size study of docs/explanation/mechanics.md: prints its table in Markdown.
///
///   build/release/bench/mechanics_bench            elements of 10, 5 and 2.5 mm; 20, 40 and 100 steps (about
///   30 s) build/release/bench/mechanics_bench --fine     and three columns in the notch (5/3 mm elements)
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include "knothe/offline/full_order/offline.hpp"

namespace {

using namespace knothe::offline;

struct Case {
  std::string name;
  double element, notch_width;
  int layers, steps;
  LeftSupport left_support = LeftSupport::support_line;
};

void run(const Case& study) {
  BeamProblem problem;
  problem.beam.element = study.element;
  problem.beam.notch_width = study.notch_width;
  problem.beam.layers = study.layers;
  problem.beam.left_support = study.left_support;
  problem.solver.steps = study.steps;
  const std::clock_t start = std::clock();
  FullOrderModel model = make_full_order_model(problem);
  const FullOrderResult result = model.run(problem.reference);
  const double cpu = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  const auto peak =
      std::max_element(result.steps.begin(), result.steps.end(),
                       [](const auto& a, const auto& b) { return a.reaction_force < b.reaction_force; });
  // The step that ends at 0.1 mm: after the peak, where the crack runs.
  const auto& quarter = result.steps[static_cast<std::size_t>((study.steps + 3) / 4 - 1)];
  std::printf(
      "| %s | %d | %d | %.4g | %.1f | %.3f | %.1f | %.1f | %.4f | %d + %d | %zu | %.2f |\n",
      study.name.c_str(), model.structure().dof_count(), study.steps,
      2 * model.structure().unit_reaction() / 1e6, peak->reaction_force, 1e3 * peak->imposed_displacement,
      quarter.imposed_displacement < 1.001e-4 ? quarter.reaction_force : 0.0,
      result.steps.back().reaction_force, result.steps.back().dissipated_energy, result.newton_iterations(),
      result.secant_iterations(), result.steps_without_equilibrium().size(), cpu);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<Case> cases;
  for (const int steps : {20, 40, 100}) {
    cases.push_back({"10 mm, notch 10 mm: one column", 0.01, 0.01, 1, steps});
    cases.push_back({"5 mm: one column (reference)", 0.005, 0.005, 1, steps});
    cases.push_back({"2.5 mm: two columns", 0.0025, 0.005, 1, steps});
    cases.push_back({"2.5 mm, notch 2.5 mm: one column", 0.0025, 0.0025, 1, steps});
  }
  std::stable_sort(cases.begin(), cases.end(),
                   [](const Case& a, const Case& b) { return a.element > b.element; });
  std::stable_sort(cases.begin(), cases.end(), [](const Case& a, const Case& b) {
    return a.element * 2 + a.notch_width > b.element * 2 + b.notch_width;
  });
  cases.push_back({"5 mm, two layers", 0.005, 0.005, 2, 100});
  cases.push_back({"5 mm, u_x = 0 on the left face", 0.005, 0.005, 1, 100, LeftSupport::left_face});
  if (argc > 1 && std::string(argv[1]) == "--fine")
    cases.push_back({"5/3 mm: three columns", 0.005 / 3, 0.005, 1, 100});
  std::printf(
      "| elements | dofs | steps | stiffness [kN/mm] | peak [N] | at [mm] | at 0.1 mm [N] | at 0.4 mm [N] | "
      "dissipated [J] | "
      "Newton + secant | not in equilibrium | CPU [s] |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
  for (const Case& study : cases) run(study);
}
