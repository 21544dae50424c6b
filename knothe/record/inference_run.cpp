#include "knothe/record/inference_run.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>

#include "knothe/assimilation/inference/derivative_check.hpp"
#include "knothe/assimilation/inference/evaluation_journal.hpp"
#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/record/inference_results.hpp"

namespace knothe::record {
namespace {

using assimilation::InferenceResult;
using posterior::Method;
using Clock = std::chrono::steady_clock;

/// All kinds of calls that were made.
std::string calls_text(const model::ModelCalls& calls) {
  std::string text = fmt::format("{} model evaluations", calls.evaluations);
  if (calls.gradients > 0) text += fmt::format(", {} gradients", calls.gradients);
  if (calls.jacobians > 0) text += fmt::format(", {} Jacobian products", calls.jacobians);
  if (calls.hessians > 0) text += fmt::format(", {} Hessian products", calls.hessians);
  return text;
}

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
  void show(const model::ModelCalls& calls) {
    const auto now = Clock::now();
    if (now - last_ < (terminal_ ? std::chrono::milliseconds(200) : std::chrono::milliseconds(10'000)))
      return;
    last_ = now;
    shown_ = true;
    const double seconds = std::chrono::duration<double>(now - start_).count();
    std::string left;
    if (share_ > 0) left = fmt::format(", {:.0f} s left", seconds * (1 - share_) / share_);
    fmt::print(stderr, "{}{}: {}, {:.0f} s{}{}", terminal_ ? "\r\033[K" : "", label_, calls_text(calls),
               seconds, left, terminal_ ? "" : "\n");
    std::fflush(stderr);
  }

 private:
  std::string label_;
  bool terminal_ = isatty(STDERR_FILENO) == 1, shown_ = false;
  double share_ = 0;
  Clock::time_point start_ = Clock::now(), last_ = start_;
};

/// Calls that an earlier run has made are not paid for twice.
void reuse_calls(assimilation::EvaluationJournal& journal, assimilation::ModelEvaluator& evaluator) {
  const assimilation::KeptCalls kept = journal.open(evaluator);
  if (kept.taken > 0)
    fmt::print(stderr, "knothe: {}: going on from {} calls of a run that did not end\n", journal.path(),
               kept.taken);
  if (!kept.refused.empty())
    fmt::print(stderr, "knothe: {}: calls of a run that did not end are not used: {}\n", journal.path(),
               kept.refused);
}

std::string kept_text(const assimilation::EvaluationJournal& journal) {
  return fmt::format("{} calls of the model are kept in {}: the same command goes on from there",
                     journal.calls(), journal.path());
}

InferenceResult infer_by(const project::Project& project, Method method, project::InferenceSetup& setup,
                         assimilation::ModelEvaluator& evaluator) {
  const bool is_server = !project.umbridge.url.empty();
  std::vector<std::string> warnings;
  if (is_server) warnings = assimilation::check_derivatives(evaluator, setup.priors, setup.parameters);
  for (const std::string& warning : warnings) fmt::print(stderr, "knothe: warning: {}\n", warning);
  assimilation::PosteriorDensity posterior(
      evaluator, setup.priors, setup.observations,
      assimilation::useful_derivatives(method, evaluator.has_gradient() || !is_server));
  assimilation::InferenceOptions options = project::inference_options(project, method);
  EvaluationCounter counter(assimilation::to_text(method));
  evaluator.progress = [&](const model::ModelCalls& calls) { counter.show(calls); };
  options.progress = [&](double share) {
    counter.set_share(share);
    return !cancellation_requested();
  };
  InferenceResult result = assimilation::infer(posterior, evaluator, options);
  evaluator.progress = {};
  for (const std::string& warning : result.warnings) fmt::print(stderr, "knothe: warning: {}\n", warning);
  result.warnings.insert(result.warnings.begin(), warnings.begin(), warnings.end());
  return result;
}

}  // namespace

InferenceRun run_inference(const project::Project& project, Method asked, const std::string& folder) {
  InferenceRun run{project::set_up_inference(project), {}, folder};
  project::InferenceSetup& setup = run.setup;
  const bool is_server = !project.umbridge.url.empty();
  const Method method = assimilation::one_shot(asked, setup.model->dimension(), setup.model->is_cheap());
  files::require_writable_folder(folder);
  assimilation::EvaluationJournal journal((std::filesystem::path(folder) / "evaluations.jsonl").string(),
                                          setup.model->where() + "\n" + project.umbridge.config);
  assimilation::ModelEvaluator evaluator(*setup.model, setup.priors, project.umbridge.difference_step);
  if (is_server) reuse_calls(journal, evaluator);
  try {
    run.result = infer_by(project, method, setup, evaluator);
  } catch (const Interrupted& interrupted) {
    if (journal.calls() == 0) journal.remove();
    if (!is_server) throw;
    throw Interrupted(fmt::format("{}; {}", interrupted.what(), kept_text(journal)));
  } catch (const std::exception&) {
    if (journal.calls() == 0) journal.remove();
    if (journal.calls() > 0) fmt::print(stderr, "knothe: {}\n", kept_text(journal));
    throw;
  }
  write_inference(folder, project, setup, run.result);
  if (!run.result.budget_spent || !is_server) journal.remove();
  return run;
}

std::string inference_text(const InferenceRun& run) {
  const InferenceResult& r = run.result;
  std::string text =
      fmt::format("{:<12} {:>12} {:>12} {:>13} {:>12} {:>12} {:>9} {:>9}\n", assimilation::to_text(r.method),
                  "mean", "std", "most probable", "2.5 %", "97.5 %", "skewness", "kurtosis");
  const Eigen::VectorXd std = r.standard_deviations();
  for (Eigen::Index k = 0; k < std.size(); ++k)
    text += fmt::format("{:<12} {:>12.5g} {:>12.4g} {:>13.5g} {:>12.5g} {:>12.5g} {:>9.3f} {:>9.3f}\n",
                        run.setup.parameters[k], r.mean[k], std[k], r.maximum_a_posteriori[k],
                        r.quantiles(k, 0), r.quantiles(k, 4), r.skewness[k], r.kurtosis[k]);
  double model_seconds = 0;
  for (const auto& phase : r.phases) model_seconds += phase.model_seconds;
  return text + fmt::format(
                    "log-evidence {:.4f} ± {:.2g}; {}; {:.3g} s, of which the model took "
                    "{:.3g} s; results in {}",
                    r.log_evidence, r.log_evidence_error, calls_text(r.calls), r.seconds(), model_seconds,
                    run.folder);
}

std::string comparison_text(const InferenceRun& first, const InferenceRun& second,
                            const assimilation::Comparison& c) {
  std::string text = fmt::format("\n{} minus {}, in units of the posterior std\n{:<16} {:>9} {:>10}",
                                 assimilation::to_text(second.result.method),
                                 assimilation::to_text(first.result.method), "", "mean", "std ratio");
  for (const double level : numerics::k_quantile_levels)
    text += fmt::format(" {:>8}", fmt::format("{:g} %", 100 * level));
  for (Eigen::Index k = 0; k < c.mean_difference.size(); ++k) {
    text += fmt::format("\n{:<16} {:>9.4f} {:>10.4f}", first.setup.parameters[k], c.mean_difference[k],
                        c.std_ratio[k]);
    for (Eigen::Index l = 0; l < c.quantile_difference.cols(); ++l)
      text += fmt::format(" {:>8.4f}", c.quantile_difference(k, l));
  }
  return text +
         fmt::format("\nlog-evidence {:+.4f} ± {:.2g}\n", c.log_evidence_difference, c.log_evidence_error);
}

}  // namespace knothe::record
