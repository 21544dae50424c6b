/// LATIN-PGD beside full-order runs on the same grid (docs/latin.md): errors, modes, CPU time.
///
///   build/release/bench/latin_study ELEMENT NODES STEPS ACCURACY [WINDOW]     one case, and with VERBOSE=1
///   its stages build/release/bench/latin_study table                                    3, 5, 7, 9 nodes for
///   each parameter build/release/bench/latin_study directions                               search
///   directions, all steps in one window
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>

#include "knothe/mechanics/latin_pgd.hpp"
#include "knothe/mechanics/offline.hpp"

namespace {

using namespace knothe::mechanics;

struct Case {
  double element = 0.01;
  int nodes = 3, steps = 40;
  LatinOptions options;
};

struct Reference {
  std::shared_ptr<const Structure> structure;
  BeamProblem problem;
  std::vector<DamageParameters> parameters;
  std::vector<FullOrderResult> runs;
  double cpu_seconds = 0;
};

Reference make_reference(const Case& study) {
  Reference result;
  result.problem.beam.element = study.element;
  result.problem.solver.steps = study.steps;
  for (int i = 0; i < study.nodes; ++i)
    for (int j = 0; j < study.nodes; ++j)
      result.parameters.push_back({216.0 * (0.5 + static_cast<double>(i) / (study.nodes - 1)),
                                   2.25e-3 * (0.5 + static_cast<double>(j) / (study.nodes - 1))});
  result.structure =
      std::make_shared<const Structure>(make_mesh(result.problem), result.problem.elastic, "beam");
  FullOrderModel full(result.structure, result.problem.solver);
  for (const DamageParameters& p : result.parameters) {
    result.runs.push_back(full.run(p));
    result.cpu_seconds += result.runs.back().cpu_seconds;
  }
  return result;
}

struct Errors {
  double relative = 0, largest = 0, peak = 0;  ///< L², m, m at 15 to 30 % of the loading
  std::vector<double> by_point;                ///< largest of each parameter point, m
};

Errors errors(const Reference& reference, const LatinSolution& latin) {
  Errors result;
  double square = 0, error = 0;
  const int dofs = reference.structure->dof_count(), steps = reference.problem.solver.steps;
  for (std::size_t p = 0; p < reference.runs.size(); ++p) {
    result.by_point.push_back(0);
    for (int step = 0; step < steps; ++step) {
      const Eigen::Map<const Eigen::VectorXd> u(
          &reference.runs[p].displacement[static_cast<std::size_t>(step) * static_cast<std::size_t>(dofs)],
          dofs);
      const Eigen::VectorXd e = latin.displacement(*reference.structure, static_cast<std::size_t>(step),
                                                   static_cast<Eigen::Index>(p)) -
                                u;
      square += u.squaredNorm();
      error += e.squaredNorm();
      const double largest = e.cwiseAbs().maxCoeff(), fraction = static_cast<double>(step + 1) / steps;
      result.by_point.back() = std::max(result.by_point.back(), largest);
      if (fraction >= 0.15 && fraction <= 0.301) result.peak = std::max(result.peak, largest);
    }
    result.largest = std::max(result.largest, result.by_point.back());
  }
  result.relative = std::sqrt(error / square);
  return result;
}

LatinSolution solve(const Reference& reference, const LatinOptions& options) {
  return solve_latin_pgd(reference.structure, reference.problem.solver, reference.parameters, options);
}

void print_row(const Case& study) {
  const Reference reference = make_reference(study);
  const LatinSolution latin = solve(reference, study.options);
  if (std::getenv("VERBOSE") != nullptr)
    for (const LatinIteration& it : latin.history)
      std::printf(
          "%3d-%3d round %2d modes %3d of %3d points %3d residual %.2e correction %.3f um change %.2e  %.2f "
          "s\n",
          it.first_step, it.last_step, it.round, it.working_modes, it.archived_modes, it.lanes, it.residual,
          it.correction * 1e6, it.indicator, it.cpu_seconds);
  const Errors e = errors(reference, latin);
  std::vector<double> sorted = e.by_point;
  std::sort(sorted.begin(), sorted.end());
  std::printf(
      "| %g mm | %d | %d × %d | %d | %zu | %td | %.1f | %.2f | %.2f | %.1f | %.1e | %.3f | %.3f | %.3f |\n",
      study.element * 1e3, reference.structure->dof_count(), study.nodes, study.nodes, latin.active_cells,
      latin.history.size(), latin.space.cols(), 1e-6 * static_cast<double>(latin.local_points),
      latin.cpu_seconds, reference.cpu_seconds, reference.cpu_seconds / latin.cpu_seconds, e.relative,
      1e6 * sorted[sorted.size() / 2], 1e6 * sorted[sorted.size() * 9 / 10], 1e6 * e.largest);
  std::fflush(stdout);
}

void print_head() {
  std::printf(
      "| elements | dofs | grid | active cells | stages | space modes | local stage, 10⁶ | LATIN, CPU s | "
      "full order, CPU s "
      "| factor | relative error | max error µm: median point | 90 %% | worst |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
}

/// One linear solve a stage for every step and point, all steps at once, as LATIN has it.
void study_directions() {
  Case study;
  study.nodes = 2;
  study.steps = 20;
  const Reference reference = make_reference(study);
  std::printf(
      "| stages | constant (C) | secant, refreshed | tangent, refreshed |\n| --- | --- | --- | --- |\n");
  for (const int rounds : {5, 10, 20, 40, 80, 160}) {
    std::printf("| %d |", rounds);
    for (const SearchDirection direction :
         {SearchDirection::elastic, SearchDirection::secant, SearchDirection::tangent}) {
      LatinOptions options;
      options.window = study.steps;
      options.rounds = rounds;
      options.rescue_round = rounds + 1;
      options.step.direction = direction;
      options.step.iterations = 1;
      options.step.best = false;
      options.step.warm_up = 0;
      options.accuracy = 1e-9;
      options.modes_per_round = 2;
      options.most_modes = 1000;
      const Errors e = errors(reference, solve(reference, options));
      std::printf(" %.1e, %.2f µm |", e.relative, 1e6 * e.largest);
      std::fflush(stdout);
    }
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string first = argc > 1 ? argv[1] : "";
  if (first == "directions") {
    study_directions();
    return 0;
  }
  print_head();
  if (first == "table") {
    for (const int nodes : {3, 5, 7, 9}) print_row({0.005, nodes, 100, {}});
    return 0;
  }
  Case study;
  if (argc > 1) study.element = std::atof(argv[1]);
  if (argc > 2) study.nodes = std::atoi(argv[2]);
  if (argc > 3) study.steps = std::atoi(argv[3]);
  if (argc > 4) study.options.accuracy = std::atof(argv[4]);
  if (argc > 5) study.options.window = std::atoi(argv[5]);
  print_row(study);
}
