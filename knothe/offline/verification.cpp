#include "knothe/offline/verification.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/model/compress/quantity_scales.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/offline/model_study.hpp"
#include "knothe/offline/posterior_judge.hpp"
#include "knothe/offline/problem.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::offline {
namespace {

using assimilation::ShiftSummary;
using Json = nlohmann::ordered_json;

void raise_to(ShiftSummary& all, const ShiftSummary& one) {
  if (one.worst_mean.mean > all.worst_mean.mean) all.worst_mean = one.worst_mean;
  if (one.worst_std.std > all.worst_std.std) all.worst_std = one.worst_std;
  all.last.mean = std::max(all.last.mean, one.last.mean);
  all.last.std = std::max(all.last.std, one.last.std);
}

Json shift_record(const ShiftSummary& shift) {
  return {{"worst", shift.worst_mean.mean},
          {"worst_step", shift.worst_mean.step},
          {"last", shift.last.mean},
          {"std_worst", shift.worst_std.std},
          {"std_last", shift.last.std}};
}

/// Largest shifts at some points, with the measurements' noise and with the model's own error added to it.
struct Shifts {
  ShiftSummary plain;
  std::optional<ShiftSummary> widened;

  void add_to(Json& line) const {
    line["posterior_shift"] = shift_record(plain);
    if (widened) line["posterior_shift_with_truncation_error"] = shift_record(*widened);
  }
};

/// What the model's error at one point does to the posterior of data from there: the same model with the data
/// û + noise that it would have explained (the judge), and with u + noise. For the judge that is the model
/// with the error e = u − û at the truth added wherever its parameters are.
class ErrorJudge {
 public:
  ErrorJudge(const SyntheticProblem& problem, const model::ModelContents& contents, const std::string& where)
      : problem_(problem), model_(contents, where) {
    const model::TruncationError truncation = model::read_truncation_error(where);
    if (truncation.count > 0 && !problem.places.empty())
      added_ = model::observe_truncation(truncation, contents, where, model::Sensors(problem.places), {},
                                         contents.time);
    observed_ = std::make_shared<const model::ObservedModel>(model::observe_dofs(model_, problem.dofs));
  }

  [[nodiscard]] Shifts shifts(const model::OffGridSolution& solution) const {
    const auto d = std::ssize(solution.parameters);
    const Eigen::VectorXd p = Eigen::Map<const Eigen::VectorXd>(solution.parameters.data(), d);
    auto right = std::make_shared<model::ObservedModel>(*observed_);
    const std::size_t n_dof = model_.dof_count();
    Eigen::MatrixXd exact(observed_->observations(), observed_->lift.cols());
    for (Index t = 0; t < exact.cols(); ++t) {
      for (Index i = 0; i < exact.rows(); ++i) exact(i, t) = solution.values[t * n_dof + problem_.dofs[i]];
      right->lift.col(t) += exact.col(t) - observed_->predict(p, t);
    }
    const PosteriorJudge judge(right, problem_, exact);
    Shifts shifts{judge.shift(observed_, judge.data.noise), std::nullopt};
    if (added_) shifts.widened = judge.shift(observed_, project::with_truncation(judge.data.noise, *added_));
    return shifts;
  }

 private:
  const SyntheticProblem problem_;
  model::SeparatedModel model_;
  std::optional<model::ObservedTruncation> added_;
  std::shared_ptr<const model::ObservedModel> observed_;
};

constexpr double k_confidence = 0.95;

/// All points together, and what they tell of the box.
void print_summary(const VerifyOptions& options, const model::ModelError& all, const std::string& largest,
                   const std::optional<Shifts>& worst, const files::CommandOutput& output) {
  // The largest of N independent draws is exceeded with probability ≤ 1 − share by a new one, with confidence
  // 0.95.
  const double share = std::pow(1 - k_confidence, 1.0 / options.points);
  Json line = {{"done", true}, {"points", options.points}, {"seed", options.seed}};
  line.update(error_record(all));
  if (worst) worst->add_to(line);
  line["confidence"] = {{"level", k_confidence}, {"share_of_parameters", share}};
  std::string text = fmt::format("{} points: error {:.2e}, of u − lift {:.2e}, {}\n", options.points,
                                 all.relative, all.relative_to_lift, largest);
  if (worst)
    text += fmt::format(
        "posterior of synthetic data from these points: mean moves by at most {:.2f} std (last step {:.2f}), "
        "std by {:.0f} %\n",
        worst->plain.worst_mean.mean, worst->plain.last.mean, 100 * worst->plain.worst_std.std);
  if (worst && worst->widened)
    text += fmt::format("with method.truncation_error = \"on\": by at most {:.2f} std (last step {:.2f})\n",
                        worst->widened->worst_mean.mean, worst->widened->last.mean);
  text += fmt::format(
      "with {:.0f} % confidence at least {:.0f} % of the box is no worse than the worst of these points",
      100 * k_confidence, 100 * share);
  output.line(line, text);
}

void require_same_model(const VerifyOptions& options, const model::ModelContents& model,
                        const model::Snapshots& solution) {
  if (solution.dof_count() == model.dof_count() && solution.time.size() == model.time.size()) return;
  throw DataError(fmt::format(
      "{}: the model has {} dofs and {} steps, the project's full-order model {} and {}: verify a "
      "model with the project file that it was built from",
      options.model, model.dof_count(), model.time.size(), solution.dof_count(), solution.time.size()));
}

}  // namespace

void verify_model(const VerifyOptions& options, const files::CommandOutput& output) {
  const project::Project project = project::read_project(options.project);
  const model::ModelContents model = model::read_model(options.model);
  const auto full_order = project_simulator(project, model.axes);
  std::optional<ErrorJudge> judge;
  if (const auto synthetic = synthetic_problem(project, model.axes, model.dofs, model.quantities))
    judge.emplace(*synthetic, model, options.model);
  // Quantities of several units: errors are relative to how each varies.
  const model::QuantityScales scales{model::SeparatedModel(model, options.model)};
  const model::ModelContents scaled_model = scales.scaled(model);
  std::vector<model::OffGridSolution> solutions;
  std::optional<Shifts> worst;
  Progress progress("full-order runs", options.points, output.json());
  for (const std::vector<double>& point : points_in_box(model.axes, options.points, options.seed)) {
    model::Snapshots solution = full_order->solve(point);
    require_same_model(options, model, solution);
    solutions.push_back({point, std::move(solution.values)});
    const model::ModelError error =
        model::off_grid_error(scaled_model, scales.scaled({&solutions.back(), 1}));
    Json line = {{"point", point}};
    line.update(error_record(error));
    std::string text;
    if (judge) {
      const Shifts shifts = judge->shifts(solutions.back());
      shifts.add_to(line);
      text = fmt::format(", posterior moves by {:.2f} std", shifts.plain.worst_mean.mean);
      if (shifts.widened)
        text += fmt::format(" ({:.2f} with truncation_error)", shifts.widened->worst_mean.mean);
      if (!worst)
        worst = Shifts{{}, shifts.widened ? std::optional<ShiftSummary>(ShiftSummary()) : std::nullopt};
      raise_to(worst->plain, shifts.plain);
      if (shifts.widened) raise_to(*worst->widened, *shifts.widened);
    }
    output.line(line, fmt::format("  ({:.4f})  error {:.2e}, of u − lift {:.2e}, {}{}",
                                  fmt::join(point, ", "), error.relative, error.relative_to_lift,
                                  model::largest_error(error.max, model.quantities), text));
    progress.advance_to(solutions.size());
  }
  const model::ModelError all = model::off_grid_error(scaled_model, scales.scaled(solutions));
  print_summary(options, all, model::largest_error(all.max, model.quantities), worst, output);
}

}  // namespace knothe::offline
