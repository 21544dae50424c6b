#include "knothe/offline/model_study.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/offline/posterior_judge.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/project/simulation.hpp"

namespace knothe::offline {
namespace {

using Json = nlohmann::ordered_json;
using model::Form;
using model::ObservedModel;

/// Those of `counts` that the solutions have modes for. Alternating least squares with more than 30 canonical
/// modes would take minutes and change nothing in the picture.
std::vector<std::size_t> possible_modes(std::initializer_list<std::size_t> counts,
                                        const model::GridSolutions& solutions, Form form) {
  std::vector<std::size_t> modes;
  for (const std::size_t m : counts)
    if (m < solutions.snapshots.grid_size() && (m <= 30 || form == Form::tree)) modes.push_back(m);
  return modes;
}

/// The uncompressed model at the observed dofs.
std::shared_ptr<const ObservedModel> uncompressed(const model::GridSolutions& solutions,
                                                  const SyntheticProblem& problem) {
  return std::make_shared<const ObservedModel>(model::observe_snapshots(solutions.at_dofs(problem.dofs)));
}

/// Judges by data that `model` predicts at `truth`.
PosteriorJudge judge_at(const std::shared_ptr<const ObservedModel>& model, const SyntheticProblem& problem,
                        const std::vector<double>& truth) {
  const Eigen::VectorXd p = Eigen::Map<const Eigen::VectorXd>(truth.data(), std::ssize(truth));
  Eigen::MatrixXd exact(model->observations(), std::ssize(model->time));
  for (Index t = 0; t < exact.cols(); ++t) exact.col(t) = model->predict(p, t);
  return {model, problem, exact};
}

assimilation::ShiftSummary shift_of(const PosteriorJudge& judge, const SyntheticProblem& problem,
                                    const model::SeparatedModel& model) {
  return judge.shift(std::make_shared<const ObservedModel>(model::observe_dofs(model, problem.dofs)),
                     judge.data.noise);
}

/// Largest |u − û| at `dofs`, whose solutions are `seen`, over the grid and all steps, m.
double largest_grid_error(const model::SeparatedModel& model, const model::Snapshots& seen,
                          std::span<const std::size_t> dofs) {
  const ObservedModel observed = model::observe_dofs(model, dofs);
  double largest = 0;
  for (std::size_t point = 0; point < seen.grid_size(); ++point)
    largest = std::max(
        largest, largest_error(observed, seen.parameters_at(point), [&](std::size_t step, std::size_t i) {
          return seen.solution(point)[step * dofs.size() + i];
        }));
  return largest;
}

constexpr const char* k_table_head =
    "\nWhat the number of modes costs. Errors on the parameter grid, and at points off it; shift of the "
    "posterior of\n"
    "synthetic data from that of the uncompressed snapshots, in posterior std (worst step / last step).\n"
    "                        on the grid                  off the grid\n"
    "  form       modes   error   of u-lift  max µm   of u-lift  max µm   shift of mean   std wrong by";

void print_line(Form form, const model::CompressionRow& row,
                const std::optional<assimilation::ShiftSummary>& shift, const files::CommandOutput& output) {
  const model::ModelError& e = row.training;
  Json record = {
      {"form", model::to_text(form)}, {"modes", row.parameter_modes}, {"space_modes", row.space_modes}};
  record.update(error_record(e));
  std::string off_grid = "      –        –", moved = "        –              –";
  if (row.off_grid) {
    record["off_grid"] = error_record(*row.off_grid);
    off_grid = fmt::format("{:.1e}  {:7.3f}", row.off_grid->relative_to_lift, row.off_grid->max * 1e6);
  }
  if (shift) {
    const auto& [mean, spread, last] = *shift;
    record["shift_of_mean"] = {{"worst", mean.mean}, {"worst_step", mean.step}, {"last", last.mean}};
    record["error_of_std"] = {{"worst", spread.std}, {"worst_step", spread.step}, {"last", last.std}};
    moved = fmt::format("{:7.2f} / {:4.2f}  {:7.1f} % / {:.1f} %", mean.mean, last.mean, 100 * spread.std,
                        100 * last.std);
  }
  output.line(record,
              fmt::format("  {:<10} {:5}  {:.1e}  {:.1e}  {:7.3f}    {}  {}", model::to_text(form),
                          row.parameter_modes, e.relative, e.relative_to_lift, e.max * 1e6, off_grid, moved));
}

}  // namespace

Json error_record(const model::ModelError& error) {
  return {{"relative_error", error.relative},
          {"relative_error_without_lift", error.relative_to_lift},
          {"max_error_m", error.max}};
}

void check_adaptive(const project::Project& project, const std::vector<model::Axis>& axes) {
  if (!project.offline->adaptive_shift) return;
  const auto has_prior = [&](const model::Axis& axis) {
    return std::any_of(project.parameters.begin(), project.parameters.end(),
                       [&](const project::NamedPrior& parameter) { return parameter.name == axis.name; });
  };
  project.require(project.simulate.has_value() && project.parameters.size() == axes.size() &&
                      std::all_of(axes.begin(), axes.end(), has_prior),
                  "[simulate], and [parameters] with a prior for each axis: offline.adaptive.posterior_shift "
                  "asks for them");
}

std::size_t choose_modes(const project::Project& project, const model::GridSolutions& solutions, Form form) {
  const project::OfflineOptions& options = *project.offline;
  const bool by_shift = options.adaptive_shift.has_value();
  const std::vector<std::size_t> candidates =
      possible_modes({3, 6, 10, 15, 20, 30, 40, 50, 65, 80, 100}, solutions, form);
  const auto problem =
      synthetic_problem(project, solutions.snapshots.axes, solutions.dofs(), solutions.snapshots.quantities);
  std::vector<PosteriorJudge> judges;
  if (by_shift) {
    project.require(problem.has_value(),
                    "[simulate] dofs that choose at least one: offline.adaptive.posterior_shift judges by "
                    "their data");
    const auto exact = uncompressed(solutions, *problem);
    // The project's truth and two points of the box.
    judges.push_back(judge_at(exact, *problem, project::simulated_truth(project, problem->names)));
    for (const auto& truth : points_in_box(solutions.snapshots.axes, 2, 3))
      judges.push_back(judge_at(exact, *problem, truth));
  }
  const std::vector<std::size_t> dofs =
      checked_dofs(project, solutions.dofs(), solutions.snapshots.quantities);
  const model::Snapshots seen = by_shift ? model::Snapshots() : solutions.at_dofs(dofs);
  model::CompressionOptions compression;
  compression.form = form;
  double reached = 0;
  const double wanted = *(by_shift ? options.adaptive_shift : options.adaptive_error);
  for (model::StudiedModel& studied : model::compression_study(solutions, compression, candidates)) {
    const model::SeparatedModel model(std::move(studied.model));
    reached = by_shift ? 0 : largest_grid_error(model, seen, dofs);
    for (const PosteriorJudge& judge : judges)
      reached = std::max(reached, shift_of(judge, *problem, model).worst_mean.mean);
    fmt::print(stderr, "{} modes: {}\n", studied.row.parameter_modes,
               by_shift ? fmt::format("posterior shift {:.3f} std", reached)
                        : fmt::format("at most {:.3f} µm on the observed dofs", 1e6 * reached));
    if (reached <= wanted) return studied.row.parameter_modes;
  }
  throw NumericalError(
      fmt::format("[offline.adaptive]: {} modes, the most that are tried on {} grid points, reach {:.3g} "
                  "where {:.3g} {} is "
                  "wanted: ask for less, or give \"modes\"",
                  candidates.empty() ? 0 : candidates.back(), solutions.snapshots.grid_size(), reached,
                  wanted, by_shift ? "std" : "m"));
}

void study_models(const project::Project& project, const model::GridSolutions& solutions,
                  const std::vector<model::OffGridSolution>& off_grid, const files::CommandOutput& output) {
  // With many grid points the uncompressed judge (a function per grid point) and alternating least squares
  // would take longer than the model.
  const bool many = solutions.snapshots.axes.size() > 3 || solutions.snapshots.grid_size() > 600;
  const auto problem =
      synthetic_problem(project, solutions.snapshots.axes, solutions.dofs(), solutions.snapshots.quantities);
  std::optional<PosteriorJudge> judge;
  if (problem && !many)
    judge = judge_at(uncompressed(solutions, *problem), *problem,
                     project::simulated_truth(project, problem->names));
  output.text(k_table_head);
  if (!solutions.snapshots.quantities.empty())
    output.text("  (dofs without a place: instead of µm, millionths of how a quantity varies)");
  for (const Form form : {Form::canonical, Form::tree}) {
    if (many && form == Form::canonical) continue;
    model::CompressionOptions options;
    options.form = form;
    for (model::StudiedModel& studied : model::compression_study(
             solutions, options, possible_modes({3, 6, 10, 20, 30, 50}, solutions, form), off_grid)) {
      std::optional<assimilation::ShiftSummary> shift;
      if (judge) shift = shift_of(*judge, *problem, model::SeparatedModel(std::move(studied.model)));
      print_line(form, studied.row, shift, output);
    }
  }
  output.text("");
}

}  // namespace knothe::offline
