#include "knothe/report/results/inference_run.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/inference/derivative_check.hpp"
#include "knothe/inference/evaluation_file.hpp"
#include "knothe/report/results/inference_results.hpp"

namespace knothe::report {
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

/// Evaluations that an interrupted run has kept are not paid for twice.
void reuse_evaluations(const std::string& path, inference::ModelEvaluator& evaluator,
                       const std::string& identity) {
  const inference::KeptEvaluations kept = inference::take_evaluations(path, evaluator, identity);
  if (kept.taken > 0)
    fmt::print(stderr, "knothe: {}: going on from {} evaluations of an interrupted run\n", path, kept.taken);
  if (!kept.refused.empty())
    fmt::print(stderr, "knothe: {}: evaluations of an interrupted run are not used: {}\n", path,
               kept.refused);
}

}  // namespace

InferenceRun run_inference(const project::Project& project, Method method, const std::string& folder) {
  InferenceRun run{project::set_up_inference(project), {}, folder};
  project::InferenceSetup& setup = run.setup;
  inference::ModelEvaluator evaluator(*setup.model, setup.priors, project.umbridge.difference_step);
  const std::string kept = (std::filesystem::path(folder) / "evaluations.h5").string();
  const std::string identity = setup.model->where() + "\n" + project.umbridge.config;
  const bool is_server = !project.umbridge.url.empty();
  files::require_writable_folder(folder);
  if (is_server) {
    reuse_evaluations(kept, evaluator, identity);
    run.result.warnings = inference::check_derivatives(evaluator, setup.priors, setup.parameters);
    for (const std::string& warning : run.result.warnings)
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
  std::vector<std::string> warnings = std::move(run.result.warnings);
  try {
    run.result = inference::infer(posterior, evaluator, options);
  } catch (const Interrupted& interrupted) {
    if (!is_server) throw;
    const Eigen::Index n = inference::keep_evaluations(kept, evaluator, identity);
    throw Interrupted(
        fmt::format("{}; {} evaluations of the model are kept in {}: the same command goes on from there",
                    interrupted.what(), n, kept));
  }
  run.result.warnings = std::move(warnings);
  write_inference(folder, project, setup, run.result);
  std::error_code none;
  std::filesystem::remove(kept, none);  // of an interrupted run: they have done their service
  return run;
}

std::string inference_text(const InferenceRun& run) {
  const InferenceResult& r = run.result;
  std::string text =
      fmt::format("{:<16} {:>12} {:>12} {:>12} {:>12} {:>12} {:>9} {:>9}\n", inference::to_text(r.method),
                  "mean", "std", "most probable", "2.5 %", "97.5 %", "skewness", "kurtosis");
  const Eigen::VectorXd std = r.standard_deviations();
  for (Eigen::Index k = 0; k < std.size(); ++k)
    text += fmt::format("{:<16} {:>12.5g} {:>12.4g} {:>13.5g} {:>12.5g} {:>12.5g} {:>9.3f} {:>9.3f}\n",
                        run.setup.parameters[static_cast<std::size_t>(k)], r.mean[k], std[k],
                        r.maximum_a_posteriori[k], r.quantiles(k, 0), r.quantiles(k, 4), r.skewness[k],
                        r.kurtosis[k]);
  double model_seconds = 0;
  for (const auto& phase : r.phases) model_seconds += phase.model_seconds;
  return text + fmt::format(
                    "log-evidence {:.4f} ± {:.2g}; {} model evaluations; {:.3g} s, of which the model took "
                    "{:.3g} s; results in {}",
                    r.log_evidence, r.log_evidence_error, r.calls.evaluations, r.seconds(), model_seconds,
                    run.folder);
}

std::string comparison_text(const InferenceRun& first, const InferenceRun& second,
                            const inference::Comparison& c) {
  std::string text = fmt::format("\n{} minus {}, in units of the posterior std\n{:<16} {:>9} {:>10}",
                                 inference::to_text(second.result.method),
                                 inference::to_text(first.result.method), "", "mean", "std ratio");
  for (const double level : numerics::k_quantile_levels)
    text += fmt::format(" {:>8}", fmt::format("{:g} %", 100 * level));
  for (Eigen::Index k = 0; k < c.mean_difference.size(); ++k) {
    text += fmt::format("\n{:<16} {:>9.4f} {:>10.4f}", first.setup.parameters[static_cast<std::size_t>(k)],
                        c.mean_difference[k], c.std_ratio[k]);
    for (Eigen::Index l = 0; l < c.quantile_difference.cols(); ++l)
      text += fmt::format(" {:>8.4f}", c.quantile_difference(k, l));
  }
  return text +
         fmt::format("\nlog-evidence {:+.4f} ± {:.2g}\n", c.log_evidence_difference, c.log_evidence_error);
}

}  // namespace knothe::report
