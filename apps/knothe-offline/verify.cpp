#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>

#include "apps/knothe-offline/commands.hpp"
#include "apps/knothe-offline/model_study.hpp"
#include "apps/knothe-offline/problem.hpp"
#include "knothe/assimilation/data/synthetic_measurements.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/truncation_noise.hpp"
#include "knothe/reduction/compress/compression.hpp"
#include "knothe/reduction/model/truncation_error.hpp"
#include "knothe/reduction/observe/observed_model.hpp"

namespace knothe::offline_commands {
namespace {

nlohmann::ordered_json errors(const reduction::ModelError& e) {
  return {{"relative_error", e.relative},
          {"relative_error_without_lift", e.relative_to_lift},
          {"max_error_m", e.max}};
}

/// Largest of a list of shifts.
void keep_worst(assimilation::ShiftSummary& all, const assimilation::ShiftSummary& one) {
  if (one.worst_mean.mean > all.worst_mean.mean) all.worst_mean = one.worst_mean;
  if (one.worst_std.std > all.worst_std.std) all.worst_std = one.worst_std;
  all.last.mean = std::max(all.last.mean, one.last.mean);
  all.last.std = std::max(all.last.std, one.last.std);
}

nlohmann::ordered_json shifts(const assimilation::ShiftSummary& shift) {
  return {{"worst", shift.worst_mean.mean},
          {"worst_step", shift.worst_mean.step},
          {"last", shift.last.mean},
          {"std_worst", shift.worst_std.std},
          {"std_last", shift.last.std}};
}

/// What the model's error at one point does to the posterior of data from there: the same model with the data
/// û + noise that it would have explained (the judge), and with u + noise. For the judge that is the model
/// with the error e = u − û at the truth added wherever its parameters are.
class PosteriorJudge {
 public:
  PosteriorJudge(const SyntheticProblem& problem, const reduction::ModelContents& contents,
                 const std::string& where)
      : problem_(problem), model_(contents, where) {
    const std::vector<std::size_t> steps = all_steps();
    const reduction::TruncationError truncation = reduction::read_truncation_error(where);
    if (truncation.count > 0)
      added_ = reduction::observe_truncation(truncation, contents, where,
                                             {problem.points, problem.components}, steps);
    observed_ =
        std::make_shared<const reduction::ObservedModel>(reduction::observe_dofs(model_, problem.dofs));
  }

  [[nodiscard]] bool has_truncation() const { return !added_.empty(); }

  /// With the measurements' noise alone, or with the model's own error added to it.
  [[nodiscard]] assimilation::ShiftSummary shift(const reduction::OffGridSolution& solution,
                                                 bool with_truncation) const {
    const auto d = static_cast<Eigen::Index>(solution.parameters.size());
    const Eigen::VectorXd p = Eigen::Map<const Eigen::VectorXd>(solution.parameters.data(), d);
    auto judge = std::make_shared<reduction::ObservedModel>(*observed_);
    const std::size_t n_dof = model_.dof_count();
    Eigen::MatrixXd exact(observed_->observations(), observed_->lift.cols());
    for (Eigen::Index t = 0; t < exact.cols(); ++t) {
      for (Eigen::Index i = 0; i < exact.rows(); ++i)
        exact(i, t) =
            solution.values[static_cast<std::size_t>(t) * n_dof + problem_.dofs[static_cast<std::size_t>(i)]];
      judge->lift.col(t) += exact.col(t) - observed_->predict(p, static_cast<std::size_t>(t));
    }
    const assimilation::Measurements data = assimilation::add_noise(
        model_.contents().dofs, problem_.dofs, observed_->time, exact, problem_.noise_std, problem_.seed);
    const auto noise = with_truncation ? project::with_truncation(data.noise, added_) : data.noise;
    return assimilation::summarise(
        assimilation::posterior_shift(observed_, judge, data.values, noise, problem_.priors));
  }

 private:
  [[nodiscard]] std::vector<std::size_t> all_steps() const {
    std::vector<std::size_t> steps(model_.step_count());
    std::iota(steps.begin(), steps.end(), std::size_t{0});
    return steps;
  }

  const SyntheticProblem problem_;
  reduction::SeparatedModel model_;
  std::vector<Eigen::MatrixXd> added_;
  std::shared_ptr<const reduction::ObservedModel> observed_;
};

constexpr double k_confidence = 0.95;

}  // namespace

int verify(const VerifyArguments& arguments) {
  const project::Project project = project::read_project(arguments.project);
  const mechanics::BeamProblem problem = beam_problem(project);
  const reduction::ModelContents model = reduction::read_model(arguments.model);
  mechanics::FullOrderModel full_order = mechanics::make_full_order_model(problem);
  if (static_cast<std::size_t>(full_order.structure().dof_count()) != model.dof_count() ||
      static_cast<std::size_t>(problem.solver.steps) != model.time.size()) {
    throw DataError(fmt::format(
        "{}: the model has {} dofs and {} steps, the project's full-order model {} and {}: verify a "
        "model with the project file that it was built from",
        arguments.model, model.dof_count(), model.time.size(), full_order.structure().dof_count(),
        problem.solver.steps));
  }
  std::optional<PosteriorJudge> judge;
  if (const auto synthetic = synthetic_problem(project, model.axes, model.dofs))
    judge.emplace(*synthetic, model, arguments.model);
  std::vector<reduction::OffGridSolution> solutions;
  assimilation::ShiftSummary plain, widened;
  Progress progress("full-order runs", static_cast<std::size_t>(arguments.points), arguments.json);
  for (const std::vector<double>& point : points_in_box(model.axes, arguments.points, arguments.seed)) {
    const reduction::OffGridSolution solution{
        point, mechanics::run_at(full_order, problem, model.axes, point).displacement};
    const reduction::ModelError error = reduction::off_grid_error(model, {&solution, 1});
    nlohmann::ordered_json line = {{"point", point}};
    line.update(errors(error));
    std::string text;
    if (judge) {
      const assimilation::ShiftSummary one = judge->shift(solution, false);
      keep_worst(plain, one);
      line["posterior_shift"] = shifts(one);
      text = fmt::format(", posterior moves by {:.2f} std", one.worst_mean.mean);
      if (judge->has_truncation()) {
        const assimilation::ShiftSummary with = judge->shift(solution, true);
        keep_worst(widened, with);
        line["posterior_shift_with_truncation_error"] = shifts(with);
        text += fmt::format(" ({:.2f} with truncation_error)", with.worst_mean.mean);
      }
    }
    if (arguments.json)
      fmt::print("{}\n", files::json_line(line));
    else
      fmt::print("  ({:.4f})  error {:.2e}, of u − lift {:.2e}, at most {:.3f} µm on any dof{}\n",
                 fmt::join(point, ", "), error.relative, error.relative_to_lift, error.max * 1e6, text);
    std::fflush(stdout);
    solutions.push_back(solution);
    progress.advance_to(solutions.size());
  }
  const reduction::ModelError all = reduction::off_grid_error(model, solutions);
  // The largest of N independent draws is exceeded with probability ≤ 1 − share by a new one, with confidence
  // 0.95.
  const double share = std::pow(1 - k_confidence, 1.0 / arguments.points);
  if (arguments.json) {
    nlohmann::ordered_json line = {{"done", true}, {"points", arguments.points}, {"seed", arguments.seed}};
    line.update(errors(all));
    if (judge) line["posterior_shift"] = shifts(plain);
    if (judge && judge->has_truncation()) line["posterior_shift_with_truncation_error"] = shifts(widened);
    line["confidence"] = {{"level", k_confidence}, {"share_of_parameters", share}};
    fmt::print("{}\n", files::json_line(line));
  } else {
    fmt::print("{} points: error {:.2e}, of u − lift {:.2e}, at most {:.3f} µm on any dof\n",
               arguments.points, all.relative, all.relative_to_lift, all.max * 1e6);
    if (judge)
      fmt::print(
          "posterior of synthetic data from these points: mean moves by at most {:.2f} std (last step "
          "{:.2f}), "
          "std by {:.0f} %\n",
          plain.worst_mean.mean, plain.last.mean, 100 * plain.worst_std.std);
    if (judge && judge->has_truncation())
      fmt::print("with method.truncation_error = \"on\": by at most {:.2f} std (last step {:.2f})\n",
                 widened.worst_mean.mean, widened.last.mean);
    fmt::print(
        "with {:.0f} % confidence at least {:.0f} % of the box is no worse than the worst of these points\n",
        100 * k_confidence, 100 * share);
  }
  return 0;
}

}  // namespace knothe::offline_commands
