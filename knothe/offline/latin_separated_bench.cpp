/// LATIN-PGD iterated in the fully separated form, beside its joint form recompressed to as many terms
/// (docs/explanation/latin.md, "Full separation"): error of the field and shift of the posterior, both judged
/// by the joint form itself.
///
///   build/release/bench/latin_separated_bench [KEY=VALUE …]
///
/// Keys: element (m), nodes, steps, judge (accuracy of the joint form, m), from_joint, from_elastic (largest
/// number of terms in those columns; 0: none), terms (that number alone; 0: all), accuracy (that one of
/// 4e-6, 2e-6, 1e-6, 5e-7, 2.5e-7 m alone; 0: all), verbose.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>

#include "knothe/assimilation/update/posterior_shift.hpp"
#include "knothe/likelihood/data/synthetic_measurements.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/offline/latin/latin_model.hpp"

namespace {

using namespace knothe;
using namespace knothe::offline;

struct SeparatedStudy {
  BeamProblem problem;
  std::vector<model::Axis> axes;
  LatinModel joint;
  std::vector<model::OffGridSolution> fields;  ///< of the joint form at the grid points
  std::vector<std::size_t> dofs;               ///< observed
  std::shared_ptr<const model::ObservedModel> judge;
  likelihood::Measurements data;
  std::vector<posterior::Prior> priors;
};

/// As examples/beam/quick.toml: 60 dofs, noise of 1 µm, truth (1, 1).
SeparatedStudy make_study(const BeamProblem& problem, int nodes, double accuracy) {
  SeparatedStudy study;
  study.problem = problem;
  std::vector<double> values;
  for (int i = 0; i < nodes; ++i) values.push_back(0.5 + static_cast<double>(i) / (nodes - 1));
  study.axes = {{"Y0", values, "1", "", 216.0}, {"Ad", values, "1", "", 2.25e-3}};
  LatinOptions options;
  options.accuracy = accuracy;
  study.joint = solve_latin_grid(problem, study.axes, options);
  const model::GridSolutions& grid = study.joint.grid;
  for (std::size_t p = 0; p < grid.snapshots.grid_size(); ++p) {
    const Eigen::MatrixXd field = grid.field(p);
    study.fields.push_back({grid.snapshots.parameters_at(p), {field.data(), field.data() + field.size()}});
  }
  likelihood::DofSelection selection;
  selection.x_range = {-0.12, 0.12};
  study.dofs = likelihood::choose_dofs(grid.dofs(), selection, 1);
  std::vector<double> points;
  std::vector<std::int64_t> components;
  for (const std::size_t dof : study.dofs) {
    points.insert(points.end(), &grid.dofs().points[3 * dof], &grid.dofs().points[3 * dof] + 3);
    components.push_back(grid.dofs().components[dof]);
  }
  study.judge = std::make_shared<const model::ObservedModel>(
      model::observe_snapshots(grid.at_dofs(study.dofs), {points, components}));
  const std::vector<double>& time = grid.snapshots.time;
  Eigen::MatrixXd exact(static_cast<Eigen::Index>(study.dofs.size()), static_cast<Eigen::Index>(time.size()));
  for (std::size_t t = 0; t < time.size(); ++t)
    exact.col(static_cast<Eigen::Index>(t)) = study.judge->predict(Eigen::Vector2d(1, 1), t);
  study.data = likelihood::add_noise(grid.dofs(), study.dofs, time, exact, 1e-6, 1);
  study.priors = {posterior::Prior::normal(0.9, std::sqrt(0.2)),
                  posterior::Prior::normal(1.1, std::sqrt(0.2))};
  return study;
}

/// Error of u, of u − lift, largest (µm); shift of the mean at the worst and the last step, and of the std.
void print_errors(const SeparatedStudy& study, const model::GridSolutions& solutions, std::size_t terms) {
  model::CompressionOptions options;
  options.form = model::Form::canonical;
  options.modes = terms;
  const model::ModelContents contents = model::compress(solutions, options);
  const model::ModelError error = model::off_grid_error(contents, study.fields);
  const model::SeparatedModel model(contents);
  const auto observed = std::make_shared<const model::ObservedModel>(model::observe_dofs(model, study.dofs));
  const assimilation::ShiftSummary shift = assimilation::summarise(assimilation::posterior_shift(
      observed, study.judge, study.data.values, study.data.noise, study.priors));
  std::printf(" %.1e | %.1e | %.2f | %.2f / %.2f | %.0f %% / %.0f %% |", error.relative,
              error.relative_to_lift, 1e6 * error.max, shift.worst_mean.mean, shift.last.mean,
              100 * shift.worst_std.std, 100 * shift.last.std);
  std::fflush(stdout);
}

void print_iterated(const SeparatedStudy& study, SeparatedOptions options, bool from_joint, bool verbose) {
  if (from_joint) {
    const LatinSolution& joint = study.joint.solution;
    options.start.space = joint.space;
    for (const Eigen::MatrixXd& states : joint.coordinates)
      options.start.coordinates.emplace_back(states.bottomRows(joint.space.cols()));
  }
  const LatinModel found = solve_separated_grid(study.problem, study.axes, options);
  if (verbose)
    for (const SeparatedIteration& it : found.separated)
      std::fprintf(
          stderr,
          "%3d steps, round %2d: %3d terms, %3d modes, energy %.2e, correction %.3f um, change %.1e, "
          "omega %.2f, %.1f s\n",
          it.steps, it.round, it.terms, it.space_modes, it.energy_error, 1e6 * it.correction, it.indicator,
          it.relaxation, it.cpu_seconds);
  const auto terms = static_cast<std::size_t>(found.grid.terms->time.cols());
  std::printf("%zu | %.2f | %.1f |", terms, 1e6 * found.separated.back().correction,
              found.solution.cpu_seconds);
  print_errors(study, found.grid, terms);
  std::printf("\n");
}

}  // namespace

int main(int argc, char** argv) {
  std::map<std::string, double> keys = {{"element", 0.01}, {"nodes", 7},       {"steps", 100},
                                        {"judge", 1e-7},   {"from_joint", 30}, {"from_elastic", 30},
                                        {"accuracy", 0},   {"terms", 0},       {"verbose", 0}};
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t at = word.find('=');
    if (at == std::string::npos || !keys.contains(word.substr(0, at))) {
      std::fprintf(stderr,
                   "latin_separated_bench [KEY=VALUE …]: see the head of latin_separated_bench.cpp\n");
      return 2;
    }
    keys[word.substr(0, at)] = std::atof(word.c_str() + at + 1);
  }
  BeamProblem problem;
  problem.beam.element = keys["element"];
  problem.solver.steps = static_cast<int>(keys["steps"]);
  const SeparatedStudy study = make_study(problem, static_cast<int>(keys["nodes"]), keys["judge"]);
  const bool verbose = keys["verbose"] != 0;
  std::printf(
      "joint form: %.1f s of CPU, %td space modes\n\n| what | m | correction µm | CPU s | error | of u − "
      "lift | max µm | shift of "
      "mean | std wrong by |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
      study.joint.solution.cpu_seconds, study.joint.solution.space.cols());
  for (const int m : {3, 6, 10, 20, 30}) {
    if (m > std::max(keys["from_joint"], keys["from_elastic"])) break;
    if (keys["terms"] != 0 && m != static_cast<int>(keys["terms"])) continue;
    std::printf("| joint, recompressed | %d | | |", m);
    print_errors(study, study.joint.grid, static_cast<std::size_t>(m));
    std::printf("\n");
    SeparatedOptions options;
    options.max_terms = m;
    options.accuracy = 1e-8;
    for (const bool from_joint : {true, false}) {
      if (m > keys[from_joint ? "from_joint" : "from_elastic"]) continue;
      std::printf("| iterated, from the %s |", from_joint ? "joint form" : "elastic solution");
      print_iterated(study, options, from_joint, verbose);
    }
  }
  for (const double accuracy : {4e-6, 2e-6, 1e-6, 5e-7, 2.5e-7}) {
    if (keys["accuracy"] != 0 && std::abs(accuracy - keys["accuracy"]) > 1e-9) continue;
    SeparatedOptions options;
    options.accuracy = accuracy;
    std::printf("| iterated to %g µm |", 1e6 * accuracy);
    print_iterated(study, options, false, verbose);
  }
}
