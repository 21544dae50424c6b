/// How far the reduced model that LATIN-PGD gives is from full-order runs at the reference and off the
/// parameter grid, and which part of that is LATIN, interpolation or compression (docs/explanation/latin.md).
///
///   build/release/bench/latin_accuracy_bench [KEY=VALUE …]
///
/// Keys: element (m), lower, upper (of the box), steps, accuracy (m), points (off the grid, besides the
/// reference), snapshots (grids with at most so many points are computed by full-order runs, too, which tells
/// what interpolation alone does), nodes (one number for each parameter; may be given several times).
///
/// Judged are the dofs that the example's camera may see: x and y on the outer face, |x| ≤ 120 mm.
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/offline/full_order/offline.hpp"
#include "knothe/offline/latin/latin_model.hpp"

namespace {

using namespace knothe::offline;
namespace model = knothe::model;

struct AccuracyStudy {
  BeamProblem problem;
  double lower = 0.5, upper = 1.5;
  int points = 3, snapshots = 0;
  LatinOptions latin;
  std::vector<int> nodes;
};

std::vector<model::Axis> axes_of(const AccuracyStudy& study, int nodes) {
  std::vector<double> values;
  for (int i = 0; i < nodes; ++i)
    values.push_back(study.lower + (study.upper - study.lower) * i / (nodes - 1));
  return {{"Y0", values, "1", "", 216.0}, {"Ad", values, "1", "", 2.25e-3}};
}

/// Element `i` of the van der Corput sequence.
double van_der_corput(int i, int base) {
  double result = 0, digit = 1.0 / base;
  for (; i > 0; i /= base, digit /= base) result += digit * (i % base);
  return result;
}

/// The reference, then Halton points of the box.
std::vector<std::vector<double>> judged_points(const AccuracyStudy& study) {
  std::vector<std::vector<double>> result = {{1.0, 1.0}};
  for (int i = 1; i <= study.points; ++i)
    result.push_back({study.lower + (study.upper - study.lower) * van_der_corput(i, 2),
                      study.lower + (study.upper - study.lower) * van_der_corput(i, 3)});
  return result;
}

std::vector<std::size_t> camera_dofs(const model::Dofs& dofs) {
  const auto place = [&](std::size_t i, std::size_t k) { return dofs.points[3 * i + k]; };
  double outer = 0;
  for (std::size_t i = 0; i < dofs.components.size(); ++i) outer = std::max(outer, place(i, 2));
  std::vector<std::size_t> result;
  for (std::size_t i = 0; i < dofs.components.size(); ++i)
    if (dofs.components[i] < 2 && outer - place(i, 2) < 1e-9 && std::abs(place(i, 0)) <= 0.12)
      result.push_back(i);
  return result;
}

/// |u − û| over dofs and steps of several points.
struct Error {
  double square = 0, size = 0, all = 0, cracking = 0;  ///< the latter: largest, at all steps and 15 to 30

  void add(double exact, double found, std::size_t step) {
    const double e = std::abs(exact - found);
    square += e * e;
    size += exact * exact;
    all = std::max(all, e);
    if (step >= 15 && step <= 30) cracking = std::max(cracking, e);
  }
  [[nodiscard]] double relative() const { return std::sqrt(square / size); }
};

struct Judge {
  std::vector<std::vector<double>> points;
  std::vector<std::size_t> dofs;
  std::vector<std::vector<double>> exact;  ///< for each point [n_t, dofs]

  /// Errors at each point of a model whose outputs are the judged dofs.
  [[nodiscard]] std::vector<Error> errors(const model::ObservedModel& model) const {
    std::vector<Error> result(points.size());
    for (std::size_t k = 0; k < points.size(); ++k)
      for (std::size_t step = 0; step < model.time.size(); ++step) {
        const Eigen::VectorXd y = model.predict(Eigen::Vector2d(points[k][0], points[k][1]), step);
        for (std::size_t i = 0; i < dofs.size(); ++i)
          result[k].add(exact[k][step * dofs.size() + i], y[static_cast<Eigen::Index>(i)], step);
      }
    return result;
  }
};

/// Columns: at each of few points, steps 15 to 30; there the median, the 90th percentile and the worst; the
/// worst at all steps; relative.
void print(const std::string& what, const std::vector<Error>& errors) {
  std::printf("| %s |", what.c_str());
  std::vector<double> cracking;
  double all = 0, relative = 0;
  for (const Error& e : errors) {
    relative = std::max(relative, e.relative());
    all = std::max(all, e.all);
    cracking.push_back(1e6 * e.cracking);
    if (errors.size() <= 5) std::printf(" %.3f |", cracking.back());
  }
  std::sort(cracking.begin(), cracking.end());
  if (errors.size() > 5)
    std::printf(" %.3f | %.3f |", cracking[cracking.size() / 2], cracking[cracking.size() * 9 / 10]);
  std::printf(" %.3f | %.3f | %.1e |\n", cracking.back(), 1e6 * all, relative);
  std::fflush(stdout);
}

std::vector<Error> latin_alone(const AccuracyStudy& study, const Judge& judge, const Structure& structure,
                               const LatinSolution& latin) {
  std::vector<Error> result(judge.points.size());
  for (std::size_t k = 0; k < judge.points.size(); ++k)
    for (int step = 0; step < study.problem.solver.steps; ++step) {
      const auto s = static_cast<std::size_t>(step);
      const Eigen::VectorXd u = latin.displacement(structure, s, static_cast<Eigen::Index>(k));
      for (std::size_t i = 0; i < judge.dofs.size(); ++i)
        result[k].add(judge.exact[k][s * judge.dofs.size() + i], u[static_cast<Eigen::Index>(judge.dofs[i])],
                      s);
    }
  return result;
}

/// The uncompressed model: splines through the solutions at the judged dofs.
model::ObservedModel splines(const model::Snapshots& seen) {
  return model::observe_snapshots(seen, seen.dofs);
}

void interpolated_runs(const AccuracyStudy& study, const Judge& judge, FullOrderModel& model, int nodes) {
  model::Snapshots grid;
  grid.axes = axes_of(study, nodes);
  const model::Dofs all = dofs(model.structure().mesh());
  for (const std::size_t i : judge.dofs) {
    grid.dofs.components.push_back(all.components[i]);
    grid.dofs.points.insert(grid.dofs.points.end(), &all.points[3 * i], &all.points[3 * i] + 3);
  }
  grid.time = model_time(study.problem.solver);
  for (std::size_t p = 0; p < grid.grid_size(); ++p) {
    const FullOrderResult run = run_at(model, study.problem, grid.axes, grid.parameters_at(p));
    for (std::size_t step = 0; step < grid.time.size(); ++step)
      for (const std::size_t i : judge.dofs)
        grid.values.push_back(run.displacement[step * all.components.size() + i]);
  }
  print(std::to_string(nodes) + ": full-order runs, splines", judge.errors(splines(grid)));
}

void study_grid(const AccuracyStudy& study, const Judge& judge, int nodes) {
  const LatinModel latin = solve_latin_grid(study.problem, axes_of(study, nodes), study.latin);
  const std::string name = std::to_string(nodes) + ": ";
  std::printf("(%d x %d: %td space modes, %.1f s of CPU)\n", nodes, nodes, latin.solution.space.cols(),
              latin.solution.cpu_seconds);
  print(name + "LATIN, splines", judge.errors(splines(latin.grid.at_dofs(judge.dofs))));
  std::vector<std::size_t> modes;
  for (const std::size_t m : {30u, 50u, 100u, 150u})
    if (m < latin.grid.snapshots.grid_size()) modes.push_back(m);
  for (model::StudiedModel& studied : model::compression_study(latin.grid, {}, modes)) {
    const std::size_t m = studied.row.parameter_modes;
    const model::SeparatedModel model(std::move(studied.model));
    print(name + "LATIN, tree of " + std::to_string(m), judge.errors(model::observe_dofs(model, judge.dofs)));
  }
}

bool set_option(AccuracyStudy& study, const std::string& word) {
  const std::size_t at = word.find('=');
  if (at == std::string::npos) return false;
  const std::string key = word.substr(0, at);
  const double value = std::atof(word.c_str() + at + 1);
  if (key == "element")
    study.problem.beam.element = value;
  else if (key == "lower")
    study.lower = value;
  else if (key == "upper")
    study.upper = value;
  else if (key == "steps")
    study.problem.solver.steps = static_cast<int>(value);
  else if (key == "accuracy")
    study.latin.accuracy = value;
  else if (key == "points")
    study.points = static_cast<int>(value);
  else if (key == "snapshots")
    study.snapshots = static_cast<int>(value);
  else if (key == "nodes")
    study.nodes.push_back(static_cast<int>(value));
  else
    return false;
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  AccuracyStudy study;
  bool understood = true;
  for (int i = 1; i < argc; ++i) understood = understood && set_option(study, argv[i]);
  if (!understood) {
    std::fprintf(stderr, "latin_accuracy_bench [KEY=VALUE …]: see the head of latin_accuracy_bench.cpp\n");
    return 2;
  }
  if (study.nodes.empty()) study.nodes = {7, 13};

  const auto structure =
      std::make_shared<const Structure>(make_mesh(study.problem), study.problem.elastic, "beam");
  FullOrderModel model(structure, study.problem.solver);
  Judge judge{judged_points(study), camera_dofs(dofs(structure->mesh())), {}};
  const auto axes = axes_of(study, 2);
  std::vector<DamageParameters> parameters;
  std::printf("%d dofs, %zu of them judged, at", structure->dof_count(), judge.dofs.size());
  for (const std::vector<double>& point : judge.points) {
    std::printf(" (%.4g, %.4g)", point[0], point[1]);
    parameters.push_back(damage_parameters(study.problem, axes, point));
    const FullOrderResult run = model.run(parameters.back());
    judge.exact.emplace_back();
    for (std::size_t step = 0; step < run.steps.size(); ++step)
      for (const std::size_t i : judge.dofs)
        judge.exact.back().push_back(
            run.displacement[step * static_cast<std::size_t>(structure->dof_count()) + i]);
  }
  std::printf("\n| nodes: what | steps 15-30, µm: %s | worst | worst, all steps | worst relative |\n",
              judge.points.size() <= 5 ? "at each point …" : "median point | 90 %");
  print("LATIN at the points themselves",
        latin_alone(study, judge, *structure,
                    solve_latin_pgd(structure, study.problem.solver, parameters, study.latin)));
  for (const int nodes : study.nodes) {
    if (nodes * nodes <= study.snapshots) interpolated_runs(study, judge, model, nodes);
    study_grid(study, judge, nodes);
  }
}
