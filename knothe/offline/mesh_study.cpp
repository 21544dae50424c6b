#include "knothe/offline/mesh_study.hpp"

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::offline {
namespace {

using project::DamageRegularisation;

/// One law on one mesh. Forces and energies of the whole beam.
struct Run {
  double element = 0;  ///< m
  int dofs = 0;
  std::vector<double> displacement, force;  ///< of every step, mm and N, from the origin
  double dissipated = 0, crack = 0;         ///< J, m: after the last step
  std::size_t not_in_equilibrium = 0;
  int newton = 0, secant = 0;
  double cpu = 0;     ///< s
  double memory = 0;  ///< MiB, the largest of the process so far
};

/// One law on all meshes.
struct MeshSeries {
  DamageRegularisation law = DamageRegularisation::none;
  std::vector<Run> runs;  ///< finer and finer
};

/// How far a run is from the next finer one.
struct Difference {
  double curve = 0;       ///< ‖F − F′‖ / ‖F′‖ over the steps
  double largest = 0;     ///< max |F − F′| / peak of F′
  double dissipated = 0;  ///< relative
  double crack = 0;       ///< relative
};

Difference difference(const Run& run, const Run& finer) {
  double square = 0, scale = 0;
  Difference result;
  for (Index i = 0; i < std::ssize(run.force); ++i) {
    const double gap = run.force[i] - finer.force[i];
    square += gap * gap;
    scale += finer.force[i] * finer.force[i];
    result.largest = std::max(result.largest, std::abs(gap));
  }
  const auto relative = [](double a, double b) { return b == 0 ? std::abs(a - b) : std::abs(a - b) / b; };
  result.curve = std::sqrt(square / scale);
  result.largest /= *std::max_element(finer.force.begin(), finer.force.end());
  result.dissipated = relative(run.dissipated, finer.dissipated);
  result.crack = relative(run.crack, finer.crack);
  return result;
}

Run compute(BeamProblem problem, DamageRegularisation law, double element) {
  problem.beam.element = element;
  // One column of elements above the notch on every mesh: an even number of columns has more than one
  // solution.
  problem.beam.notch_width = element;
  problem.solver.regularisation.kind = law;
  FullOrderModel model = make_full_order_model(problem);
  Progress progress(fmt::format("{}, elements of {:g} mm", to_text(law), 1e3 * element),
                    problem.solver.steps);
  const FullOrderResult result =
      model.run(problem.reference, [&](int step) { progress.advance_to(step + 1); });
  Run run;
  run.element = element;
  run.dofs = model.structure().dof_count();
  run.displacement = run.force = {0.0};
  for (const auto& step : result.steps) {
    run.displacement.push_back(1e3 * step.imposed_displacement);
    run.force.push_back(step.reaction_force);
  }
  run.dissipated = result.steps.back().dissipated_energy;
  run.crack = result.crack_length;
  run.not_in_equilibrium = result.steps_without_equilibrium().size();
  run.newton = result.newton_iterations();
  run.secant = result.secant_iterations();
  run.cpu = result.cpu_seconds;
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  run.memory = usage.ru_maxrss / 1024.0;
  return run;
}

void report(DamageRegularisation law, const Run& run, const files::CommandOutput& output) {
  const std::size_t peak = std::max_element(run.force.begin(), run.force.end()) - run.force.begin();
  output.line(
      {{"law", to_text(law)},
       {"element_m", run.element},
       {"dofs", run.dofs},
       {"peak_N", run.force[peak]},
       {"peak_at_mm", run.displacement[peak]},
       {"last_force_N", run.force.back()},
       {"dissipated_J", run.dissipated},
       {"crack_length_m", run.crack},
       {"newton_iterations", run.newton},
       {"secant_iterations", run.secant},
       {"steps_without_equilibrium", run.not_in_equilibrium},
       {"cpu_seconds", run.cpu},
       {"memory_MiB", run.memory}},
      fmt::format(
          "| {} | {:g} | {} | {:.1f} | {:.3f} | {:.1f} | {:.4f} | {:.1f} | {} + {} | {} | {:.1f} | {:.0f} |",
          to_text(law), 1e3 * run.element, run.dofs, run.force[peak], run.displacement[peak],
          run.force.back(), run.dissipated, 1e3 * run.crack, run.newton, run.secant, run.not_in_equilibrium,
          run.cpu, run.memory));
}

void report_differences(const std::vector<MeshSeries>& studies, const files::CommandOutput& output) {
  output.text(
      "\n| law | from | to mm | curve, L2 | curve, largest / peak | dissipated | crack length |\n"
      "| --- | --- | --- | --- | --- | --- | --- |");
  for (const MeshSeries& study : studies)
    for (Index i = 1; i < std::ssize(study.runs); ++i) {
      const Run &run = study.runs[i - 1], &finer = study.runs[i];
      const Difference d = difference(run, finer);
      output.line({{"law", to_text(study.law)},
                   {"from_m", run.element},
                   {"to_m", finer.element},
                   {"curve", d.curve},
                   {"curve_largest", d.largest},
                   {"dissipated", d.dissipated},
                   {"crack_length", d.crack}},
                  fmt::format("| {} | {:g} | {:g} | {:.2f} % | {:.2f} % | {:.2f} % | {:.2f} % |",
                              to_text(study.law), 1e3 * run.element, 1e3 * finer.element, 100 * d.curve,
                              100 * d.largest, 100 * d.dissipated, 100 * d.crack));
    }
}

std::string title_of(DamageRegularisation law) {
  switch (law) {
    case DamageRegularisation::none:
      return "the law as it is";
    case DamageRegularisation::crack_band:
      return "crack band";
    case DamageRegularisation::gradient:
      return "implicit gradient";
  }
  return {};
}

void draw(const std::vector<MeshSeries>& studies, const MeshStudyOptions& options) {
  report::Page page("Load against displacement on several meshes", options.project);
  nlohmann::ordered_json figures = nlohmann::ordered_json::array();
  std::vector<report::FigurePlace> places;
  for (const MeshSeries& study : studies) {
    nlohmann::ordered_json figure = {{"xLabel", "imposed displacement [mm]"}, {"yLabel", "force [N]"}};
    for (const Run& run : study.runs) {
      figure["x"].push_back(run.displacement);
      figure["y"].push_back(run.force);
      figure["labels"].push_back(fmt::format("{:g} mm, crack {:.1f} mm", 1e3 * run.element, 1e3 * run.crack));
    }
    places.push_back({fmt::format("curves:{}", figures.size()), title_of(study.law)});
    figures.push_back(std::move(figure));
  }
  page.figures(places);
  files::write_text_atomically(options.figure,
                               page.html({{"kind", "curves"}, {"figures", std::move(figures)}}));
}

}  // namespace

void study_meshes(const MeshStudyOptions& options, const files::CommandOutput& output) {
  if (!options.figure.empty() && !options.figure.ends_with(".html"))
    throw UsageError(
        fmt::format("-o {}: the curves are a page: give a name that ends in .html", options.figure));
  BeamProblem problem = beam_problem(project::read_project(options.project));
  if (!problem.gmsh_file.empty())
    throw ProjectError(options.project +
                       ": a mesh study makes its own meshes of the beam: leave out [offline] mesh.gmsh");
  if (options.steps > 0) problem.solver.steps = options.steps;
  std::vector<double> elements = options.elements;
  std::sort(elements.rbegin(), elements.rend());
  output.text(
      "| law | element mm | dofs | peak N | at mm | at the end N | dissipated J | crack mm | Newton + secant "
      "| steps not in equilibrium | CPU s | memory MiB |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
  std::vector<MeshSeries> studies;
  for (const DamageRegularisation law : options.laws) {
    MeshSeries study{law, {}};
    for (const double element : elements) {
      study.runs.push_back(compute(problem, law, element));
      report(law, study.runs.back(), output);
    }
    studies.push_back(std::move(study));
  }
  report_differences(studies, output);
  if (!options.figure.empty()) draw(studies, options);
}

}  // namespace knothe::offline
