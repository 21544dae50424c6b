#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/knothe/commands.hpp"
#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/inference/comparison.hpp"
#include "knothe/inference/derivative_check.hpp"
#include "knothe/inference/evaluation_file.hpp"
#include "knothe/project/inference_setup.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/report/results/inference_results.hpp"

namespace knothe::commands {
namespace {

using inference::InferenceResult;
using inference::Method;
using Clock = std::chrono::steady_clock;

/// What a person sees meanwhile: a line that changes on a terminal, one line every 10 s elsewhere. How much
/// is to be done is known only where the method says so.
class EvaluationCounter {
 public:
  explicit EvaluationCounter(std::string label) : label_(std::move(label)) {}
  ~EvaluationCounter() {
    if (terminal_ && shown_) std::fputs("\r\033[K", stderr);
  }
  EvaluationCounter(const EvaluationCounter&) = delete;
  EvaluationCounter& operator=(const EvaluationCounter&) = delete;

  void set_share(double share) { share_ = share; }
  void show(const inference::ModelCalls& calls) {
    const auto now = Clock::now();
    if (now - last_ < (terminal_ ? std::chrono::milliseconds(200) : std::chrono::milliseconds(10'000)))
      return;
    last_ = now;
    shown_ = true;
    const double seconds = std::chrono::duration<double>(now - start_).count();
    std::string left;
    if (share_ > 0) left = fmt::format(", {:.0f} s left", seconds * (1 - share_) / share_);
    fmt::print(stderr, "{}{}: {} model evaluations, {:.0f} s{}{}", terminal_ ? "\r\033[K" : "", label_,
               calls.evaluations, seconds, left, terminal_ ? "" : "\n");
    std::fflush(stderr);
  }

 private:
  std::string label_;
  bool terminal_ = isatty(STDERR_FILENO) == 1, shown_ = false;
  double share_ = 0;
  Clock::time_point start_ = Clock::now(), last_ = start_;
};

void require_possible(const project::Project& project, Method method, bool overridden) {
  if (method != Method::grid || project.parameters.size() <= 3) return;
  const std::string text =
      fmt::format("a grid takes at most 3 parameters, and there are {}: use transport, mcmc or smc",
                  project.parameters.size());
  if (overridden) throw UsageError(text);
  throw project.error_at("method.kind", text);
}

struct Answer {
  project::InferenceSetup setup;
  InferenceResult result;
  std::string folder;
};

/// Evaluations that an interrupted run has kept are not paid for twice.
void take_up(const std::string& path, inference::ModelEvaluator& evaluator, const std::string& identity) {
  const inference::KeptEvaluations kept = inference::take_evaluations(path, evaluator, identity);
  if (kept.taken > 0)
    fmt::print(stderr, "knothe: {}: going on from {} evaluations of an interrupted run\n", path, kept.taken);
  if (!kept.refused.empty())
    fmt::print(stderr, "knothe: {}: evaluations of an interrupted run are not used: {}\n", path,
               kept.refused);
}

/// One method, with a model of its own, so that its count of evaluations is its own.
Answer run(const project::Project& project, Method method, const std::string& folder) {
  Answer answer{project::set_up_inference(project), {}, folder};
  project::InferenceSetup& setup = answer.setup;
  inference::ModelEvaluator evaluator(*setup.model, setup.priors, project.umbridge.difference_step);
  const std::string kept = (std::filesystem::path(folder) / "evaluations.h5").string();
  const std::string identity = setup.model->where() + "\n" + project.umbridge.config;
  const bool is_server = !project.umbridge.url.empty();
  files::require_writable_folder(folder);
  if (is_server) {
    take_up(kept, evaluator, identity);
    answer.result.warnings = inference::check_derivatives(evaluator, setup.priors, setup.parameters);
    for (const std::string& warning : answer.result.warnings)
      fmt::print(stderr, "knothe: warning: {}\n", warning);
  }
  // Samplers pay for every derivative with model evaluations unless the model has gradients of its own.
  const bool map = method == Method::transport || method == Method::grid;
  const bool own_gradient = evaluator.has_gradient() || !is_server;
  inference::PosteriorDensity posterior(evaluator, setup.priors, setup.observations,
                                        map            ? 2
                                        : own_gradient ? 1
                                                       : 0);
  inference::InferenceOptions options = project::inference_options(project, method);
  EvaluationCounter counter(inference::to_text(method));
  evaluator.progress = [&](const inference::ModelCalls& calls) { counter.show(calls); };
  options.progress = [&](double share) {
    counter.set_share(share);
    return !cancellation_requested();
  };
  std::vector<std::string> warnings = std::move(answer.result.warnings);
  try {
    answer.result = inference::infer(posterior, evaluator, options);
  } catch (const Interrupted& interrupted) {
    if (!is_server) throw;
    const Eigen::Index n = inference::keep_evaluations(kept, evaluator, identity);
    throw Interrupted(
        fmt::format("{}; {} evaluations of the model are kept in {}: the same command goes on from there",
                    interrupted.what(), n, kept));
  }
  answer.result.warnings = std::move(warnings);
  report::write_inference(folder, project, setup, answer.result);
  std::error_code none;
  std::filesystem::remove(kept, none);  // of an interrupted run: they have done their service
  return answer;
}

void print_answer(const Answer& answer) {
  const InferenceResult& r = answer.result;
  fmt::print("{:<16} {:>12} {:>12} {:>12} {:>12} {:>12} {:>9} {:>9}\n", inference::to_text(r.method), "mean",
             "std", "most probable", "2.5 %", "97.5 %", "skewness", "kurtosis");
  const Eigen::VectorXd std = r.standard_deviations();
  for (Eigen::Index k = 0; k < std.size(); ++k)
    fmt::print("{:<16} {:>12.5g} {:>12.4g} {:>13.5g} {:>12.5g} {:>12.5g} {:>9.3f} {:>9.3f}\n",
               answer.setup.parameters[static_cast<std::size_t>(k)], r.mean[k], std[k],
               r.maximum_a_posteriori[k], r.quantiles(k, 0), r.quantiles(k, 4), r.skewness[k], r.kurtosis[k]);
  double model_seconds = 0;
  for (const auto& phase : r.phases) model_seconds += phase.model_seconds;
  fmt::print(
      "log-evidence {:.4f} ± {:.2g}; {} model evaluations; {:.3g} s, of which the model took {:.3g} s; "
      "results in "
      "{}\n",
      r.log_evidence, r.log_evidence_error, r.calls.evaluations, r.seconds(), model_seconds, answer.folder);
}

void print_comparison(const Answer& a, const Answer& b, const inference::Comparison& c) {
  const std::string first = inference::to_text(a.result.method), second = inference::to_text(b.result.method);
  fmt::print("\n{} minus {}, in units of the posterior std\n", second, first);
  fmt::print("{:<16} {:>9} {:>10}", "", "mean", "std ratio");
  for (const double level : numerics::k_quantile_levels)
    fmt::print(" {:>8}", fmt::format("{:g} %", 100 * level));
  fmt::print("\n");
  for (Eigen::Index k = 0; k < c.mean_difference.size(); ++k) {
    fmt::print("{:<16} {:>9.4f} {:>10.4f}", a.setup.parameters[static_cast<std::size_t>(k)],
               c.mean_difference[k], c.std_ratio[k]);
    for (Eigen::Index l = 0; l < c.quantile_difference.cols(); ++l)
      fmt::print(" {:>8.4f}", c.quantile_difference(k, l));
    fmt::print("\n");
  }
  fmt::print("log-evidence {:+.4f} ± {:.2g}\n\n", c.log_evidence_difference, c.log_evidence_error);
}

int exit_status(bool trusted) {
  return static_cast<int>(trusted ? ExitStatus::done : ExitStatus::numerical);
}

int compare(const InferArguments& arguments, const project::Project& project) {
  const auto comma = arguments.compare.find(',');
  if (comma == std::string::npos || arguments.compare.find(',', comma + 1) != std::string::npos)
    throw UsageError("--compare takes two methods: --compare transport,mcmc");
  if (!arguments.method.empty()) throw UsageError("--compare and --method exclude each other");
  const Method first = inference::method_from(arguments.compare.substr(0, comma));
  const Method second = inference::method_from(arguments.compare.substr(comma + 1));
  if (first == second) throw UsageError("--compare takes two different methods");
  std::vector<Answer> answers;
  for (const Method method : {first, second}) require_possible(project, method, true);
  for (const Method method : {first, second}) {
    const std::string folder = (std::filesystem::path(project.results) / inference::to_text(method)).string();
    answers.push_back(run(project, method, folder));
    const Answer& answer = answers.back();
    if (arguments.json)
      fmt::print("{}\n", files::json_line(report::inference_record(answer.result, answer.setup.parameters,
                                                                   report::samples_path(folder))));
    else
      print_answer(answer);
    std::fflush(stdout);
  }
  const inference::Comparison comparison = inference::compare(answers[0].result, answers[1].result);
  const std::string line = files::json_line(
      report::comparison_record(comparison, inference::to_text(first), inference::to_text(second)));
  files::write_text_atomically((std::filesystem::path(project.results) / "comparison.json").string(),
                               line + "\n");
  if (arguments.json) {
    fmt::print("{}\n", line);
  } else {
    print_comparison(answers[0], answers[1], comparison);
    for (const Answer& answer : answers)
      fmt::print("{}: {}\n", inference::to_text(answer.result.method), answer.result.verdict);
  }
  return exit_status(answers[0].result.trusted && answers[1].result.trusted);
}

}  // namespace

int infer(const InferArguments& arguments) {
  project::Project project = project::read_project(arguments.project);
  if (!arguments.results.empty()) project.results = arguments.results;
  if (!arguments.compare.empty()) return compare(arguments, project);
  const bool overridden = !arguments.method.empty();
  if (!overridden && !inference::is_one_shot(project.method.kind)) {
    throw project.error_at("method.kind",
                           fmt::format("method.kind = \"{}\" is for `knothe assimilate`; one-shot inference "
                                       "takes \"transport\", \"mcmc\", \"smc\" or \"grid\"",
                                       to_text(project.method.kind)));
  }
  const Method method = overridden ? inference::method_from(arguments.method) : project.method.kind;
  require_possible(project, method, overridden);
  const Answer answer = run(project, method, project.results);
  if (arguments.json) {
    fmt::print("{}\n", files::json_line(report::inference_record(answer.result, answer.setup.parameters,
                                                                 report::samples_path(answer.folder))));
  } else {
    print_answer(answer);
    fmt::print("{}\n", answer.result.verdict);
  }
  return exit_status(answer.result.trusted);
}

}  // namespace knothe::commands
