#include "knothe/service/site/line.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "knothe/project/refinement.hpp"

namespace knothe::service {
namespace {

constexpr Eigen::Index k_samples = 400;
constexpr double k_informed = 0.2;  // of the prior's std: more than the error of so many draws

/// Draws in the middle of equal shares of the weight: the same every time.
Eigen::MatrixXd systematic_draws(const posterior::Posterior& posterior) {
  const Eigen::Index n = std::min(k_samples, posterior.points.rows());
  Eigen::MatrixXd drawn(n, posterior.points.cols());
  const double share = posterior.weights.sum() / n;
  double cumulative = posterior.weights[0];
  for (Eigen::Index k = 0, i = 0; k < n; ++k) {
    while (cumulative < (k + 0.5) * share && i + 1 < posterior.points.rows())
      cumulative += posterior.weights[++i];
    drawn.row(k) = posterior.points.row(i);
  }
  return drawn;
}

std::string message_of(const assimilation::Verdict& verdict) {
  for (const assimilation::VerdictReason& reason : verdict.reasons)
    if (reason.level == verdict.level) return reason.message;
  return "";
}

}  // namespace

std::shared_ptr<Line> make_line(const assimilation::StepResult& step,
                                std::shared_ptr<const ServedModel> model, const Eigen::VectorXd& values) {
  const project::UpdateSetup& setup = model->setup;
  const assimilation::UpdateResult& result = step.update;
  auto line = std::make_shared<Line>();
  line->step = result.step;
  line->time = result.time;
  line->mean = result.mean;
  line->std = result.covariance.diagonal().cwiseSqrt();
  line->samples = systematic_draws(step.update);
  line->trusted = result.trusted;
  line->remark = result.remark;
  line->verdict = result.verdict.level;
  line->verdict_message = message_of(result.verdict);
  line->misfit = result.verdict.latest;
  if (const assimilation::VerdictReason* misfit = result.verdict.misfit())
    line->misfit_message = misfit->message;
  line->model_doubted = project::doubts_model(result.verdict);
  line->monitor_alarm = result.monitor.alarm;
  line->bias_corrected = result.bias_corrected;
  line->notice = result.notice;
  line->stuck = step.stuck, line->absent = step.absent;
  line->bias = step.bias;
  line->residual = values - setup.problem.model->predict(result.mean, result.step);
  for (Eigen::Index i = 0; i < line->residual.size(); ++i) {
    line->missing.push_back(std::isnan(line->residual[i]));
    if (line->missing.back()) line->residual[i] = 0;
  }
  for (const assimilation::NamedForecast& named : step.forecasts)
    line->above_threshold[named.name] = named.forecast.probability_above_threshold;
  line->model = std::move(model);
  return line;
}

bool is_informed(const Line& line, const std::vector<posterior::Prior>& priors) {
  if (line.samples.rows() < 2) return true;
  for (std::size_t k = 0; k < priors.size(); ++k) {
    // Under the prior these are standard normal.
    const Eigen::ArrayXd z =
        line.samples.col(k).unaryExpr([&](double p) { return priors[k].to_standard_normal(p); });
    const double mean = z.mean(), std = std::sqrt((z - mean).square().mean());
    if (std::abs(mean) > k_informed || std::abs(std - 1) > k_informed) return true;
  }
  return false;
}

Json misfit_record(const assimilation::Misfit& misfit) {
  return {{"statistic", misfit.statistic}, {"values", misfit.values}, {"probability", misfit.probability}};
}

}  // namespace knothe::service
