#include "apps/knothe-offline/model_study.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "knothe/assimilation/data/synthetic_measurements.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/project/simulation.hpp"
#include "knothe/reduction/observe/observed_model.hpp"

namespace knothe::offline_commands {
namespace {

using reduction::ObservedModel;

/// The uncompressed model at the observed dofs.
std::shared_ptr<const ObservedModel> uncompressed(const reduction::GridSolutions& solutions,
                                                  const SyntheticProblem& problem) {
  return std::make_shared<const ObservedModel>(
      reduction::observe_snapshots(solutions.at_dofs(problem.dofs), {problem.points, problem.components}));
}

/// The dofs at which [simulate] measures; none where there is no such table, or where it draws pictures.
std::vector<std::size_t> simulated_dofs(const project::Project& project, const reduction::Dofs& dofs) {
  if (!project.simulate) return {};
  return assimilation::choose_dofs(dofs, project.simulate->dofs, project.simulate->seed);
}

/// Synthetic data of the uncompressed model at a truth, and the posterior they give: the judge.
struct Judge {
  std::shared_ptr<const ObservedModel> model;
  SyntheticProblem problem;
  assimilation::Measurements data;
};

Judge make_judge(std::shared_ptr<const ObservedModel> model, const SyntheticProblem& problem,
                 const reduction::GridSolutions& solutions, const std::vector<double>& truth) {
  const Eigen::VectorXd p =
      Eigen::Map<const Eigen::VectorXd>(truth.data(), static_cast<Eigen::Index>(truth.size()));
  const std::vector<double>& time = solutions.snapshots.time;
  Eigen::MatrixXd exact(static_cast<Eigen::Index>(problem.dofs.size()),
                        static_cast<Eigen::Index>(time.size()));
  for (std::size_t t = 0; t < time.size(); ++t)
    exact.col(static_cast<Eigen::Index>(t)) = model->predict(p, t);
  return {
      std::move(model), problem,
      assimilation::add_noise(solutions.dofs(), problem.dofs, time, exact, problem.noise_std, problem.seed)};
}

assimilation::ShiftSummary shift_from(const Judge& judge, const reduction::SeparatedModel& model) {
  const auto observed =
      std::make_shared<const ObservedModel>(reduction::observe_dofs(model, judge.problem.dofs));
  return assimilation::summarise(assimilation::posterior_shift(observed, judge.model, judge.data.values,
                                                               judge.data.noise, judge.problem.priors));
}

/// Largest |u − û| at `dofs`, whose solutions are `seen`, over the grid and all steps, m.
double largest_error(const reduction::SeparatedModel& model, const reduction::Snapshots& seen,
                     std::span<const std::size_t> dofs) {
  const ObservedModel observed = reduction::observe_dofs(model, dofs);
  double largest = 0;
  for (std::size_t point = 0; point < seen.grid_size(); ++point) {
    const std::vector<double> at = seen.parameters_at(point);
    const Eigen::VectorXd p =
        Eigen::Map<const Eigen::VectorXd>(at.data(), static_cast<Eigen::Index>(at.size()));
    for (std::size_t step = 0; step < seen.time.size(); ++step) {
      const Eigen::VectorXd y = observed.predict(p, step);
      for (std::size_t i = 0; i < dofs.size(); ++i)
        largest = std::max(largest, std::abs(y[static_cast<Eigen::Index>(i)] -
                                             seen.solution(point)[step * dofs.size() + i]));
    }
  }
  return largest;
}

}  // namespace

std::optional<SyntheticProblem> synthetic_problem(const project::Project& project,
                                                  const std::vector<reduction::Axis>& axes,
                                                  const reduction::Dofs& dofs) {
  if (!project.simulate || project.parameters.size() != axes.size()) return std::nullopt;
  SyntheticProblem problem;
  for (const reduction::Axis& axis : axes) {
    for (const project::NamedPrior& parameter : project.parameters)
      if (parameter.name == axis.name) problem.priors.push_back(parameter.prior);
    problem.names.push_back(axis.name);
  }
  if (problem.priors.size() != axes.size()) return std::nullopt;
  problem.dofs = simulated_dofs(project, dofs);
  if (problem.dofs.empty()) return std::nullopt;
  for (const std::size_t dof : problem.dofs) {
    problem.points.insert(problem.points.end(), &dofs.points[3 * dof], &dofs.points[3 * dof] + 3);
    problem.components.push_back(dofs.components[dof]);
  }
  problem.noise_std = project.simulate->noise_std;
  problem.seed = project.simulate->seed;
  return problem;
}

std::vector<std::size_t> judged_dofs(const project::Project& project, const reduction::Dofs& dofs) {
  if (std::vector<std::size_t> chosen = simulated_dofs(project, dofs); !chosen.empty()) return chosen;
  std::vector<std::size_t> all(dofs.components.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return all;
}

std::vector<std::vector<double>> points_in_box(const std::vector<reduction::Axis>& axes, int count,
                                               std::uint64_t seed) {
  const Eigen::MatrixXd unit = numerics::sobol_points(count, static_cast<Eigen::Index>(axes.size()), seed);
  std::vector<std::vector<double>> points(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t k = 0; k < axes.size(); ++k) {
      const std::vector<double>& nodes = axes[k].nodes;
      points[i].push_back(nodes.front() + unit(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) *
                                              (nodes.back() - nodes.front()));
    }
  return points;
}

void check_adaptive(const project::Project& project, const std::vector<reduction::Axis>& axes) {
  if (!project.offline->adaptive_shift) return;
  const auto has_prior = [&](const reduction::Axis& axis) {
    return std::any_of(project.parameters.begin(), project.parameters.end(),
                       [&](const project::NamedPrior& parameter) { return parameter.name == axis.name; });
  };
  project.require(project.simulate.has_value() && project.parameters.size() == axes.size() &&
                      std::all_of(axes.begin(), axes.end(), has_prior),
                  "[simulate], and [parameters] with a prior for each axis: offline.adaptive.posterior_shift "
                  "asks for them");
}

std::size_t choose_modes(const project::Project& project, const reduction::GridSolutions& solutions,
                         reduction::Form form) {
  const project::OfflineOptions& options = *project.offline;
  const bool by_shift = options.adaptive_shift.has_value();
  std::vector<std::size_t> candidates;
  for (const std::size_t m : {3u, 6u, 10u, 15u, 20u, 30u, 40u, 50u, 65u, 80u, 100u})
    if (m < solutions.snapshots.grid_size() && (m <= 30 || form == reduction::Form::tree))
      candidates.push_back(m);
  std::vector<Judge> judges;
  if (by_shift) {
    const auto problem = synthetic_problem(project, solutions.snapshots.axes, solutions.dofs());
    project.require(problem.has_value(),
                    "[simulate] dofs that choose at least one: offline.adaptive.posterior_shift judges by "
                    "their data");
    const auto exact = uncompressed(solutions, *problem);
    // The project's truth and two points of the box.
    judges.push_back(
        make_judge(exact, *problem, solutions, project::simulated_truth(project, problem->names)));
    for (const auto& truth : points_in_box(solutions.snapshots.axes, 2, 3))
      judges.push_back(make_judge(exact, *problem, solutions, truth));
  }
  const std::vector<std::size_t> dofs = judged_dofs(project, solutions.dofs());
  const reduction::Snapshots seen = by_shift ? reduction::Snapshots() : solutions.at_dofs(dofs);
  reduction::CompressionOptions compression;
  compression.form = form;
  double reached = 0;
  const double wanted = *(by_shift ? options.adaptive_shift : options.adaptive_error);
  for (reduction::StudiedModel& studied : reduction::compression_study(solutions, compression, candidates)) {
    const reduction::SeparatedModel model(std::move(studied.model));
    reached = by_shift ? 0 : largest_error(model, seen, dofs);
    for (const Judge& judge : judges) reached = std::max(reached, shift_from(judge, model).worst_mean.mean);
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

std::vector<StudyLine> study_models(const project::Project& project,
                                    const reduction::GridSolutions& solutions,
                                    const std::vector<reduction::OffGridSolution>& off_grid) {
  std::optional<Judge> judge;
  // With many parameters the uncompressed judge (a function per grid point) and alternating least squares
  // would take longer than the model.
  const bool many = solutions.snapshots.axes.size() > 3;
  if (const auto problem = synthetic_problem(project, solutions.snapshots.axes, solutions.dofs());
      problem && !many)
    judge = make_judge(uncompressed(solutions, *problem), *problem, solutions,
                       project::simulated_truth(project, problem->names));
  std::vector<StudyLine> lines;
  for (const reduction::Form form : {reduction::Form::canonical, reduction::Form::tree}) {
    if (many && form == reduction::Form::canonical) continue;
    std::vector<std::size_t> modes;
    for (std::size_t m : {3u, 6u, 10u, 20u, 30u, 50u}) {
      // Alternating least squares with 50 canonical modes would take minutes and change nothing in the
      // picture.
      if (m < solutions.snapshots.grid_size() && (m <= 30 || form == reduction::Form::tree))
        modes.push_back(m);
    }
    reduction::CompressionOptions options;
    options.form = form;
    for (reduction::StudiedModel& studied :
         reduction::compression_study(solutions, options, modes, off_grid)) {
      StudyLine line{form, studied.row, std::nullopt};
      if (judge) {
        const reduction::SeparatedModel model(std::move(studied.model));
        line.shift = shift_from(*judge, model);
      }
      lines.push_back(std::move(line));
    }
  }
  return lines;
}

void report_study(const std::vector<StudyLine>& lines, bool json) {
  if (!json) {
    fmt::print(
        "\nWhat the number of modes costs. Errors on the parameter grid, and at points off it; shift of the "
        "posterior of\n"
        "synthetic data from that of the uncompressed snapshots, in posterior std (worst step / last step).\n"
        "                        on the grid                  off the grid\n"
        "  form       modes   error   of u-lift  max µm   of u-lift  max µm   shift of mean   std wrong "
        "by\n");
  }
  for (const StudyLine& line : lines) {
    const auto& e = line.errors.training;
    if (json) {
      nlohmann::ordered_json record = {{"form", reduction::to_text(line.form)},
                                       {"modes", line.errors.parameter_modes},
                                       {"space_modes", line.errors.space_modes},
                                       {"relative_error", e.relative},
                                       {"relative_error_without_lift", e.relative_to_lift},
                                       {"max_error_m", e.max}};
      if (line.errors.off_grid) {
        record["off_grid"] = {{"relative_error", line.errors.off_grid->relative},
                              {"relative_error_without_lift", line.errors.off_grid->relative_to_lift},
                              {"max_error_m", line.errors.off_grid->max}};
      }
      if (line.shift) {
        record["shift_of_mean"] = {{"worst", line.shift->worst_mean.mean},
                                   {"worst_step", line.shift->worst_mean.step},
                                   {"last", line.shift->last.mean}};
        record["error_of_std"] = {{"worst", line.shift->worst_std.std},
                                  {"worst_step", line.shift->worst_std.step},
                                  {"last", line.shift->last.std}};
      }
      fmt::print("{}\n", files::json_line(record));
      continue;
    }
    std::string shift = "        –              –";
    if (line.shift) {
      shift = fmt::format("{:7.2f} / {:4.2f}  {:7.1f} % / {:.1f} %", line.shift->worst_mean.mean,
                          line.shift->last.mean, 100 * line.shift->worst_std.std, 100 * line.shift->last.std);
    }
    std::string off_grid = "      –        –";
    if (line.errors.off_grid) {
      off_grid = fmt::format("{:.1e}  {:7.3f}", line.errors.off_grid->relative_to_lift,
                             line.errors.off_grid->max * 1e6);
    }
    fmt::print("  {:<10} {:5}  {:.1e}  {:.1e}  {:7.3f}    {}  {}\n", reduction::to_text(line.form),
               line.errors.parameter_modes, e.relative, e.relative_to_lift, e.max * 1e6, off_grid, shift);
  }
  if (!json) fmt::print("\n");
}

}  // namespace knothe::offline_commands
