/// LATIN-PGD beside full-order runs on the same grid (docs/explanation/latin.md): errors, modes, CPU time,
/// memory.
///
///   build/release/bench/latin_bench table [KEY=VALUE …]   3, 5, 7 and 9 nodes for each parameter
///   build/release/bench/latin_bench case [KEY=VALUE …]    one case
///   build/release/bench/latin_bench directions            search directions, all steps in one window
///
/// Keys: element (m), layers, band (1: crack band of 5 mm, the notch one element wide), nodes, steps,
/// accuracy (m), window, judges (grid points at which the full-order model is run; 0: all), start (nodes for
/// each parameter of a snapshot model to start from; 0: the elastic solution), modes (of that model),
/// archive (space modes at most), verbose.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <map>
#include <string>

#include "knothe/model/compress/compression.hpp"
#include "knothe/offline/full_order/offline.hpp"
#include "knothe/offline/latin/latin_pgd.hpp"

namespace {

using namespace knothe::offline;
namespace model = knothe::model;

struct Case {
  double element = 0.005;
  int layers = 1, nodes = 7, steps = 100, judges = 0, start = 0, modes = 9;
  bool band = false, verbose = false;
  LatinOptions options;
};

BeamProblem problem_of(const Case& study) {
  BeamProblem problem;
  problem.beam.element = study.element;
  problem.beam.layers = study.layers;
  problem.solver.steps = study.steps;
  if (study.band) {
    problem.beam.notch_width = study.element;
    problem.solver.regularisation.kind = DamageRegularisation::crack_band;
  }
  return problem;
}

std::vector<model::Axis> axes_of(int nodes) {
  std::vector<double> values;
  for (int i = 0; i < nodes; ++i) values.push_back(0.5 + static_cast<double>(i) / (nodes - 1));
  return {{"Y0", values, "1", "", 216.0}, {"Ad", values, "1", "", 2.25e-3}};
}

std::vector<DamageParameters> grid_of(int nodes) {
  model::Snapshots grid;
  grid.axes = axes_of(nodes);
  std::vector<DamageParameters> result;
  for (std::size_t i = 0; i < grid.grid_size(); ++i)
    result.push_back(damage_parameters({}, grid.axes, grid.parameters_at(i)));
  return result;
}

double cpu_seconds() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

/// Largest resident size since the last call, MiB (Linux).
double peak_memory() {
  double result = 0;
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (word == "VmHWM:") status >> result;
  std::ofstream("/proc/self/clear_refs") << 5;
  return result / 1024;
}

/// A model of few snapshots, as `knothe offline` makes it.
LatinStart snapshot_start(const Case& study, const BeamProblem& problem,
                          const std::shared_ptr<const Structure>& structure) {
  FullOrderModel full(structure, problem.solver);
  model::Snapshots snapshots;
  std::vector<double> values;
  for (const DamageParameters& p : grid_of(study.start)) {
    snapshots = as_snapshots(problem, *structure, full.run(p));
    values.insert(values.end(), snapshots.values.begin(), snapshots.values.end());
  }
  snapshots.values = std::move(values);
  snapshots.axes = axes_of(study.start);
  snapshots.outputs.clear();
  model::CompressionOptions compression;
  compression.modes = static_cast<std::size_t>(study.modes);
  return start_from(model::SeparatedModel(model::compress(snapshots, compression)), problem, *structure,
                    axes_of(study.nodes));
}

struct Errors {
  double relative = 0, largest = 0;  ///< L², m
  std::vector<double> by_point;      ///< largest of each judged point, m
  double cpu_seconds = 0;            ///< of the full-order runs
};

/// The judge: full-order runs at `judges` points spread over the grid, or at all.
Errors errors(const Case& study, const BeamProblem& problem,
              const std::shared_ptr<const Structure>& structure, const LatinSolution& latin) {
  const std::vector<DamageParameters> parameters = grid_of(study.nodes);
  const std::size_t count = study.judges > 0 ? static_cast<std::size_t>(study.judges) : parameters.size();
  FullOrderModel full(structure, problem.solver);
  Errors result;
  double square = 0, error = 0;
  const auto dofs = static_cast<std::size_t>(structure->dof_count());
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t p = (2 * k + 1) * parameters.size() / (2 * count);
    const FullOrderResult run = full.run(parameters[p]);
    result.cpu_seconds += run.cpu_seconds;
    result.by_point.push_back(0);
    for (std::size_t step = 0; step < run.steps.size(); ++step) {
      const Eigen::Map<const Eigen::VectorXd> u(&run.displacement[step * dofs],
                                                static_cast<Eigen::Index>(dofs));
      const Eigen::VectorXd e = latin.displacement(*structure, step, static_cast<Eigen::Index>(p)) - u;
      square += u.squaredNorm();
      error += e.squaredNorm();
      result.by_point.back() = std::max(result.by_point.back(), e.cwiseAbs().maxCoeff());
    }
    result.largest = std::max(result.largest, result.by_point.back());
  }
  result.relative = std::sqrt(error / square);
  return result;
}

void print_row(const Case& study) {
  const BeamProblem problem = problem_of(study);
  (void)peak_memory();
  const double before = cpu_seconds();
  const auto structure = std::make_shared<const Structure>(make_mesh(problem), problem.elastic, "beam");
  LatinOptions options = study.options;
  if (study.start > 0) options.start = snapshot_start(study, problem, structure);
  const double started = cpu_seconds();
  const LatinSolution latin = solve_latin_pgd(structure, problem.solver, grid_of(study.nodes), options);
  const double cpu = cpu_seconds() - started, memory = peak_memory();
  if (study.verbose)
    for (const LatinIteration& it : latin.history)
      std::printf(
          "%3d-%3d round %2d modes %3d of %3d points %3d residual %.2e correction %.3f um change %.2e  %.2f "
          "s\n",
          it.first_step, it.last_step, it.round, it.working_modes, it.archived_modes, it.lanes, it.residual,
          it.correction * 1e6, it.indicator, it.cpu_seconds);
  std::printf("| %g mm | %d | %d × %d | %d | %zu | %td | %.1f | %.2f | %.2f | %.0f |", study.element * 1e3,
              structure->dof_count(), study.nodes, study.nodes, latin.active_cells, latin.history.size(),
              latin.space.cols(), 1e-6 * static_cast<double>(latin.local_points), started - before, cpu,
              memory);
  std::fflush(stdout);
  const Errors e = errors(study, problem, structure, latin);
  std::vector<double> sorted = e.by_point;
  std::sort(sorted.begin(), sorted.end());
  const double all = e.cpu_seconds * study.nodes * study.nodes / static_cast<double>(sorted.size());
  std::printf(" %zu | %.2f | %.1f | %.1e | %.3f | %.3f | %.3f |\n", sorted.size(), all, all / cpu, e.relative,
              1e6 * sorted[sorted.size() / 2], 1e6 * sorted[sorted.size() * 9 / 10], 1e6 * e.largest);
  std::fflush(stdout);
}

void print_head() {
  std::printf(
      "| elements | dofs | grid | active cells | stages | space modes | local stage, 10⁶ | body and start, "
      "CPU s | "
      "LATIN, CPU s | peak MiB | judged at | full order at all, CPU s | factor | relative error | max error "
      "µm: median point | 90 %% | worst |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- "
      "|\n");
  std::fflush(stdout);
}

/// One linear solve a stage for every step and point, all steps at once, as LATIN has it.
void study_directions() {
  Case study;
  study.element = 0.01;
  study.nodes = 2;
  study.steps = 20;
  const BeamProblem problem = problem_of(study);
  const auto structure = std::make_shared<const Structure>(make_mesh(problem), problem.elastic, "beam");
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
      options.max_modes = 1000;
      const Errors e = errors(study, problem, structure,
                              solve_latin_pgd(structure, problem.solver, grid_of(study.nodes), options));
      std::printf(" %.1e, %.2f µm |", e.relative, 1e6 * e.largest);
      std::fflush(stdout);
    }
    std::printf("\n");
  }
}

/// Sets one KEY=VALUE; false if there is no such key.
bool set_option(Case& study, const std::string& word) {
  const std::size_t at = word.find('=');
  if (at == std::string::npos) return false;
  const double value = std::atof(word.c_str() + at + 1);
  const std::map<std::string, int*> whole = {
      {"layers", &study.layers},         {"nodes", &study.nodes},
      {"steps", &study.steps},           {"judges", &study.judges},
      {"start", &study.start},           {"modes", &study.modes},
      {"window", &study.options.window}, {"archive", &study.options.max_modes}};
  const std::map<std::string, double*> real = {{"element", &study.element},
                                               {"accuracy", &study.options.accuracy}};
  const std::map<std::string, bool*> flags = {{"band", &study.band}, {"verbose", &study.verbose}};
  const std::string key = word.substr(0, at);
  if (whole.contains(key))
    *whole.at(key) = static_cast<int>(value);
  else if (real.contains(key))
    *real.at(key) = value;
  else if (flags.contains(key))
    *flags.at(key) = value != 0;
  else
    return false;
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  Case study;
  bool understood = what == "table" || what == "case" || what == "directions";
  for (int i = 2; i < argc; ++i) understood = understood && set_option(study, argv[i]);
  if (!understood) {
    std::fprintf(stderr,
                 "latin_bench table|case|directions [KEY=VALUE …]: see the head of latin_bench.cpp\n");
    return 2;
  }
  if (what == "directions") {
    study_directions();
    return 0;
  }
  print_head();
  if (what == "case") print_row(study);
  if (what == "table")
    for (const int nodes : {3, 5, 7, 9}) {
      study.nodes = nodes;
      print_row(study);
    }
}
