#include "knothe/offline/adaptive_runs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "knothe/assimilation/select/run_selection.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/model/grid/sparse_solutions.hpp"
#include "knothe/model/simulator/grid_runs.hpp"
#include "knothe/offline/full_order/beam_simulator.hpp"
#include "knothe/offline/grid_solving.hpp"
#include "knothe/offline/posterior_judge.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/project/priors.hpp"

namespace knothe::offline {
namespace {

using assimilation::RunSelectionOptions;
using assimilation::RunSelectionStep;
using assimilation::SelectedRuns;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using model::Snapshots;
using posterior::Prior;

/// The priors of the axes, in their order, truncated to the box.
std::vector<Prior> priors_of(const project::Project& project, const std::vector<model::Axis>& axes) {
  const std::vector<Prior> all = project::priors_of(project);
  std::vector<Prior> priors;
  std::vector<model::Axis> with_prior;
  for (const model::Axis& axis : axes)
    for (std::size_t k = 0; k < all.size(); ++k)
      if (project.parameters[k].name == axis.name) {
        priors.push_back(all[k]);
        with_prior.push_back(axis);
      }
  return likelihood::truncated_to_box(with_prior, std::move(priors));
}

RunSelectionOptions selection_options(const project::OfflineOptions& options) {
  return {.shift = *options.adaptive_grid_shift, .runs = static_cast<std::size_t>(options.adaptive_runs)};
}

/// The project's solver as a function of points, and the runs it has made.
class ObservedRuns {
 public:
  ObservedRuns(const project::Project& project, model::Simulator& solver, const std::string& parts_folder,
               const files::CommandOutput& output)
      : project_(project),
        solver_(solver),
        output_(output),
        share_(share_of_ranks()),
        grid_(run_grid_of(project, parts_folder)) {}

  [[nodiscard]] bool is_first() const { return share_.rank == 0; }
  [[nodiscard]] std::size_t computed() const { return computed_; }

  /// Predictions at the points in units of their noise, n × (n_t n_obs); NaN where a run has failed.
  MatrixXd operator()(const std::vector<std::vector<double>>& points) {
    const model::PointRuns found = solve(points);
    const auto is_in = [](const std::vector<std::size_t>& some, std::size_t n) {
      return std::binary_search(some.begin(), some.end(), n);
    };
    computed_ += found.computed.size() + found.failed.size();
    const auto count = std::ssize(points);
    MatrixXd result = MatrixXd::Constant(count, std::max<Index>(columns_, 1), std::nan(""));
    for (Index n = 0; n < std::ssize(points); ++n) {
      if (is_in(found.failed, n)) continue;
      const model::FinishedRun run = model::read_run(found.runs[n]);
      if (is_first()) report_run({points[n], !is_in(found.computed, n), run.record}, output_);
      if (!problem_) set_frame(run.solution);
      const VectorXd row = observed(run.solution, found.runs[n].file);
      if (columns_ == 0) {
        columns_ = row.size();
        result.setConstant(count, columns_, std::nan(""));
      }
      result.row(n) = row.transpose();
      runs_.push_back(found.runs[n]);
    }
    return result;
  }

  /// What all solutions have in common, without values.
  [[nodiscard]] const Snapshots& frame() const { return frame_; }
  /// Runs `first` … of all that were asked for.
  [[nodiscard]] std::vector<Snapshots> solutions(std::size_t first, std::size_t count) const {
    std::vector<Snapshots> result;
    for (std::size_t n = first; n < first + count; ++n) result.push_back(model::read_run(runs_[n]).solution);
    return result;
  }

 private:
  model::PointRuns solve(const std::vector<std::vector<double>>& points) {
    try {
      return model::run_points(solver_, grid_, points, share_);
    } catch (const Interrupted& interrupted) {  // which tells of this round alone
      throw Interrupted(
          fmt::format("{} (the {} of the rounds before are kept too)", interrupted.what(), runs_.size()));
    }
  }

  void set_frame(const Snapshots& first) {
    const std::optional<Snapshots> shared = solver_.frame();
    frame_ = shared ? *shared : first;
    frame_.axes = grid_.axes;
    frame_.time = first.time;
    frame_.time_units = first.time_units;
    frame_.values.clear();
    frame_.outputs.clear();
    size_ = first.values.size();
    problem_ = synthetic_problem(project_, grid_.axes, frame_.dofs, frame_.quantities);
    project_.require(problem_.has_value(),
                     "[simulate] dofs or noise that choose at least one sensor: offline.adaptive.grid_shift "
                     "plans the runs for them");
  }

  [[nodiscard]] VectorXd observed(const Snapshots& solution, const std::string& file) const {
    if (solution.values.size() != size_ || solution.time != frame_.time)
      throw DataError(
          fmt::format("{}: this solution has {} values at {} times, the first one {} at {}, or "
                      "other times: all must have the same",
                      file, solution.values.size(), solution.time.size(), size_, frame_.time.size()));
    const auto count = std::ssize(problem_->dofs);
    const std::size_t times = solution.time.size(), dofs = solution.dof_count();
    VectorXd result(count * times);
    for (std::size_t t = 0; t < times; ++t)
      for (Index k = 0; k < count; ++k)
        result[t * count + k] = solution.values[t * dofs + problem_->dofs[k]] / problem_->noise_std[k];
    return result;
  }

  const project::Project& project_;
  model::Simulator& solver_;
  const files::CommandOutput& output_;
  model::JobShare share_;
  model::RunGrid grid_;
  std::vector<model::Run> runs_;
  std::size_t computed_ = 0;
  std::optional<SyntheticProblem> problem_;
  Snapshots frame_;
  std::size_t size_ = 0;
  Index columns_ = 0;
};

std::string duration(double seconds) {
  if (seconds < 90) return fmt::format("{:.0f} s", seconds);
  if (seconds < 5400) return fmt::format("{:.0f} min", seconds / 60);
  return fmt::format("{:.1f} h", seconds / 3600);
}

/// Tells after each round where the selection stands and what is left.
class RoundReport {
 public:
  RoundReport(const RunSelectionOptions& options, const ObservedRuns& runs,
              const files::CommandOutput& output)
      : options_(options), runs_(runs), output_(output) {}

  void operator()(const SelectedRuns& selected) const {
    if (!runs_.is_first()) return;
    const RunSelectionStep& step = selected.history.back();
    output_.record({{"runs", step.runs},
                    {"expected_shift", step.expected},
                    {"held_out_shift", step.held_out},
                    {"degrees", degrees(selected)}});
    std::string rest;
    if (!selected.reached && selected.history.size() > 2) {
      const std::size_t more = runs_to_go(selected.history, options_);
      rest = fmt::format("; about {} more", counted(more, "run"));
      const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
      if (runs_.computed() > 0)
        rest += fmt::format(", {}", duration(elapsed.count() / runs_.computed() * more));
    }
    fmt::print(stderr,
               "{} runs, degrees {}: posterior shift {:.3g} std expected, {:.3g} at held-out runs{}\n",
               step.runs, fmt::join(degrees(selected), " "), step.expected, step.held_out, rest);
  }

 private:
  static std::vector<int> degrees(const SelectedRuns& selected) {
    std::vector<int> result;
    for (Index i = 0; i < selected.interpolation.dimension(); ++i)
      result.push_back(selected.interpolation.degree(i));
    return result;
  }

  RunSelectionOptions options_;
  const ObservedRuns& runs_;
  const files::CommandOutput& output_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// The axes with as many nodes as splines need to be no worse than the interpolation.
std::vector<model::Axis> model_axes(const SelectedRuns& selected, const std::vector<Prior>& priors,
                                    std::vector<model::Axis> axes, double wanted) {
  assimilation::ExpectedShift shift(priors);
  shift.set(selected.interpolation, selected.surpluses);
  // Of the shift, for the splines of all axes together: what they miss is independent, so squares add up.
  constexpr double k_share = 0.3;
  choose_nodes(selected.interpolation,
               {.error = [&](const auto& missed) { return shift.of_factors(missed); },
                .allowed = k_share * wanted / std::sqrt(axes.size())},
               axes);
  return axes;
}

void warn_if_missed(const SelectedRuns& selected, const RunSelectionOptions& options) {
  if (selected.reached) return;
  const RunSelectionStep& step = selected.history.back();
  fmt::print(
      stderr,
      "knothe: warning: [offline.adaptive] grid_shift = {:g} is not met with {} runs: {:.3g} expected, "
      "{:.3g} at the held-out runs. The model is made from these. Allow more than runs = {}, make the "
      "box smaller, or ask for less; finished runs are kept\n",
      options.shift, step.runs, step.expected, step.held_out, options.runs);
}

/// The grid of the model's splines must fit in memory, with the solutions and with the model's functions.
void require_small(const Snapshots& frame, const Snapshots& first) {
  constexpr std::size_t k_directions = 300, k_functions = 500;
  constexpr double k_max_numbers = 1.5e8;  // numbers
  const std::size_t values =
      std::max(k_functions, std::min(first.values.size(), k_directions * frame.time.size()));
  if (1.0 * frame.grid_size() * values <= k_max_numbers) return;
  throw NumericalError(fmt::format(
      "[offline.adaptive]: all runs are made, but the splines of the model need a grid of {} points, which "
      "does not fit in memory: ask for a larger grid_shift, a smaller box or fewer parameters (finished runs "
      "are kept)",
      fmt::join(frame.grid_shape(), " × ")));
}

}  // namespace

void check_grid_shift(const project::Project& project, const std::vector<model::Axis>& axes) {
  if (!project.offline->adaptive_grid_shift) return;
  project.require(project.simulate.has_value() && priors_of(project, axes).size() == axes.size() &&
                      project.parameters.size() == axes.size(),
                  "[simulate], and [parameters] with a prior for each axis: offline.adaptive.grid_shift asks "
                  "for them");
  const RunSelectionOptions options = selection_options(*project.offline);
  if (const std::size_t least = assimilation::min_runs(options, axes.size()); options.runs < least)
    throw ProjectError(fmt::format(
        "[offline.adaptive] runs is {}: grid_shift needs {} at least for {} parameters, {} held out to judge "
        "by and three values of each parameter",
        options.runs, least, axes.size(), options.held_out));
}

SolvedGrid solve_adaptive_grid(const project::Project& project, model::Simulator& solver,
                               const std::string& parts_folder, const files::CommandOutput& output) {
  const std::vector<model::Axis> axes = parameter_axes(project);
  const std::vector<Prior> priors = priors_of(project, axes);
  const RunSelectionOptions options = selection_options(*project.offline);
  VectorXd lower(std::ssize(axes)), upper(lower.size());
  for (Index i = 0; i < std::ssize(axes); ++i) {
    lower[i] = axes[i].nodes.front();
    upper[i] = axes[i].nodes.back();
  }
  ObservedRuns runs(project, solver, parts_folder, output);
  const SelectedRuns selected =
      select_runs(priors, lower, upper, options, std::ref(runs), RoundReport(options, runs, output));
  SolvedGrid result;
  result.failed = selected.failed;
  if (!runs.is_first()) return result;
  warn_if_missed(selected, options);
  const std::size_t held_out = selected.held_out_points.size();
  const std::size_t made = selected.points.size() + held_out + selected.failed;
  output.text(
      fmt::format("{} full-order runs ({} reused from an earlier call)", made, made - runs.computed()));
  Snapshots frame = runs.frame();
  frame.axes = model_axes(selected, priors, axes, options.shift);
  const std::vector<Snapshots> solutions = runs.solutions(held_out, selected.points.size());
  require_small(frame, solutions.front());
  result.solutions = interpolate_on_grid(selected.interpolation, std::move(frame), solutions);
  model::validate(result.solutions.snapshots, "full-order runs");
  result.off_grid = model::fields_of(runs.solutions(0, held_out));
  return result;
}

}  // namespace knothe::offline
