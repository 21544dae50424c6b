#include "knothe/assimilation/select/run_selection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/numerics/functions/degree_growth.hpp"

namespace knothe::assimilation {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

std::vector<double> as_vector(const VectorXd& p) {
  return {p.data(), p.data() + p.size()};
}

VectorXd as_eigen(const std::vector<double>& p) {
  return Eigen::Map<const VectorXd>(p.data(), std::ssize(p));
}

/// The rows of `more` below those of `matrix`.
void append_rows(MatrixXd& matrix, const MatrixXd& more) {
  const Index before = matrix.rows();
  matrix.conservativeResize(before + more.rows(), more.cols());
  matrix.bottomRows(more.rows()) = more;
}

void check(const RunSelectionOptions& options, std::size_t parameters) {
  if (!(options.shift > 0)) throw UsageError("run selection: the shift that is wanted must be positive");
  if (const std::size_t least = min_runs(options, parameters); options.runs < least)
    throw UsageError(fmt::format(
        "{} runs are allowed, and {} are the least for {} parameters: {} held out to judge by, and three "
        "values of each parameter",
        options.runs, least, parameters, options.held_out));
}

std::vector<std::vector<double>> held_out_points(const ExpectedShift& shift, Index count) {
  constexpr std::uint64_t k_seed = 271;
  const MatrixXd points = shift.draw(count, k_seed);
  std::vector<std::vector<double>> result;
  for (Index k = 0; k < count; ++k) result.push_back(as_vector(points.row(k).transpose()));
  return result;
}

/// How far the interpolation is from the held-out runs.
double held_out_shift(const SelectedRuns& selected, const ExpectedShift& shift, const MatrixXd& exact) {
  double worst = 0;
  for (std::size_t k = 0; k < selected.held_out_points.size(); ++k) {
    const VectorXd p = as_eigen(selected.held_out_points[k]);
    const VectorXd error =
        exact.row(k).transpose() - selected.surpluses.transpose() * selected.interpolation.basis(p);
    worst = std::max(worst, shift.at(p, error));
  }
  return worst;
}

/// Removes the points that have no solution, and their rows; how many.
std::size_t remove_failed(std::vector<std::vector<double>>& points, MatrixXd& rows) {
  std::size_t kept = 0;
  for (std::size_t n = 0; n < points.size(); ++n) {
    if (!rows.row(n).allFinite()) continue;
    rows.row(kept) = rows.row(n);
    points[kept++] = points[n];
  }
  const std::size_t failed = points.size() - kept;
  points.resize(kept);
  rows.conservativeResize(kept, rows.cols());
  return failed;
}

/// What nothing can be made without: the middle of the box, and the first end of each axis.
void require_beginning(const numerics::MultiIndex& failed) {
  const int total = std::accumulate(failed.begin(), failed.end(), 0);
  if (total > 1) return;
  const auto i = std::find(failed.begin(), failed.end(), 1) - failed.begin();
  throw NumericalError(
      total == 0 ? std::string("there is no solution in the middle of the box: nothing can be built on it")
                 : fmt::format("there is no solution at the upper end of parameter {} (the others in the "
                               "middle), and all that the model knows of it is built on that: make the box "
                               "smaller (finished runs are kept)",
                               i + 1));
}

/// The runs of the indices that are new, each with its place in the interpolation; indices without a solution
/// are left out.
void add_round(numerics::DegreeGrowth& growth, const Predictions& predictions, SelectedRuns& selected,
               MatrixXd& values) {
  const std::size_t first = selected.points.size();
  numerics::SparseInterpolation with_all = selected.interpolation;
  std::vector<std::vector<double>> asked;
  for (std::size_t n = first; n < growth.indices().size(); ++n) {
    with_all.add(growth.indices()[n]);
    asked.push_back(as_vector(with_all.node(growth.indices()[n])));
  }
  MatrixXd found = predictions(asked);
  for (std::size_t n = 0, place = first; n < asked.size(); ++n) {
    const numerics::MultiIndex index = growth.indices()[place];
    if (found.row(n).allFinite()) {
      selected.interpolation.add(index);
      ++place;
    } else {
      require_beginning(index);
      growth.leave_out(place);
    }
  }
  selected.failed += remove_failed(asked, found);
  append_rows(values, found);
  selected.points.insert(selected.points.end(), asked.begin(), asked.end());
}

/// Where the held-out runs are missed by so much more than is expected, the expectation is blind.
constexpr double k_contradiction = 5;

}  // namespace

std::size_t min_runs(const RunSelectionOptions& options, std::size_t parameters) {
  return options.held_out + 2 * parameters + 1;
}

SelectedRuns select_runs(const std::vector<posterior::Prior>& priors, const VectorXd& lower,
                         const VectorXd& upper, const RunSelectionOptions& options,
                         const Predictions& predictions,
                         const std::function<void(const SelectedRuns&)>& told) {
  check(options, priors.size());
  ExpectedShift shift(priors);
  SelectedRuns selected{{lower, upper}, {}, held_out_points(shift, options.held_out), {}, {}};
  MatrixXd held_out = predictions(selected.held_out_points);
  selected.failed = remove_failed(selected.held_out_points, held_out);
  if (2 * selected.held_out_points.size() < static_cast<std::size_t>(options.held_out))
    throw NumericalError(
        fmt::format("only {} of {} held-out runs have a solution, too few to judge by: make the box smaller "
                    "(finished runs are kept)",
                    selected.held_out_points.size(), options.held_out));
  numerics::DegreeGrowth growth(priors.size(), options.largest_degree);
  MatrixXd values(0, held_out.cols());
  while (true) {
    add_round(growth, predictions, selected, values);
    selected.surpluses = selected.interpolation.surpluses(values);
    shift.set(selected.interpolation, selected.surpluses);
    const VectorXd indicator = shift.of_each();
    std::vector<bool> active(growth.indices().size());
    for (std::size_t n = 0; n < active.size(); ++n) active[n] = growth.is_active(n);
    const RunSelectionStep step{selected.points.size() + selected.held_out_points.size() + selected.failed,
                                shift.of_all(active), held_out_shift(selected, shift, held_out)};
    selected.history.push_back(step);
    // The first rounds, a constant and a slope in each parameter, know no curvature.
    selected.reached = selected.history.size() > 2 && step.shift() <= options.shift;
    if (told) told(selected);
    if (selected.reached || step.runs >= options.runs) return selected;
    growth.expand(std::span(indicator.data(), indicator.size()),
                  step.held_out > k_contradiction * step.expected, options.runs - step.runs);
    if (growth.indices().size() == selected.points.size()) return selected;
  }
}

std::size_t runs_to_go(const std::vector<RunSelectionStep>& history, const RunSelectionOptions& options) {
  const RunSelectionStep& last = history.back();
  const std::size_t room = options.runs - std::min(options.runs, last.runs);
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (const RunSelectionStep& step : history) {
    if (2 * step.runs < last.runs || !(step.shift() > 0)) continue;
    const double log_runs = std::log(step.runs), log_shift = std::log(step.shift());
    n += 1;
    x += log_runs;
    y += log_shift;
    xx += log_runs * log_runs;
    xy += log_runs * log_shift;
  }
  const double spread = n * xx - x * x;
  if (n < 3 || !(spread > 0)) return room;
  const double power = (n * xy - x * y) / spread;
  if (!(power < -0.1)) return room;
  const double factor = std::pow(options.shift / std::max(last.shift(), options.shift), 1 / power);
  const double more = last.runs * (factor - 1);
  return more < room ? static_cast<std::size_t>(std::ceil(more)) : room;
}

}  // namespace knothe::assimilation
