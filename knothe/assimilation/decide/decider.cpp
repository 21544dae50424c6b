#include "knothe/assimilation/decide/decider.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "knothe/assimilation/forecast/horizon.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/step/posterior_functions.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

constexpr Index k_times_at_once = 8;   // that the risk is looked at
constexpr Index k_every_draw = 8;      // is one of those at which a measurement is linearised
constexpr double k_same_time = 1e-6;   // of a step of the model
constexpr double k_caution_width = 1;  // standard deviations of q that `caution` adds to it

std::vector<std::string> forecast_names(const std::vector<ForecastSpecification>& forecasts) {
  std::vector<std::string> names;
  for (const ForecastSpecification& forecast : forecasts) names.push_back(forecast.name);
  return names;
}

const ForecastSpecification* find_forecast(const std::vector<ForecastSpecification>& forecasts,
                                           const std::string& name) {
  const auto found = std::find_if(forecasts.begin(), forecasts.end(),
                                  [&](const ForecastSpecification& f) { return f.name == name; });
  return found == forecasts.end() ? nullptr : &*found;
}

const ForecastSpecification& failure_of(const std::vector<ForecastSpecification>& forecasts,
                                        const DecisionOptions& options) {
  const ForecastSpecification* forecast = find_forecast(forecasts, options.failure);
  const std::vector<std::string> names = forecast_names(forecasts);
  if (forecast == nullptr)
    throw ProjectError(fmt::format("[decide.failure] \"{}\" is not a forecast{}; there are: {}",
                                   options.failure, did_you_mean(options.failure, names),
                                   names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
  if (!forecast->threshold)
    throw ProjectError(
        fmt::format("[decide.failure] forecast.{} needs \"threshold\": beyond it the specimen "
                    "counts as failed",
                    options.failure));
  return *forecast;
}

/// "crack > 40 mm".
std::string failure_in_words(const ForecastSpecification& failure, const std::string& units) {
  if (units == "m") return fmt::format("{} > {:g} mm", failure.name, 1e3 * *failure.threshold);
  return fmt::format("{} > {:g}{}{}", failure.name, *failure.threshold, units.empty() ? "" : " ", units);
}

/// Silverman's, of values without outliers.
double kernel_width(double std, Index count) {
  return 0.9 * std * std::pow(count, -0.2);
}

std::string percent(double probability) {
  if (probability < 1e-4) return "< 0.01 %";
  return probability > 0.999 ? "> 99.9 %" : fmt::format("{:.3g} %", 100 * probability);
}

/// Rows of B, p ↦ B p, of all parameters or the one of that name.
Eigen::MatrixXd parameters_about(const std::vector<std::string>& parameters, const std::string& about) {
  const Index d = std::ssize(parameters);
  if (about.empty()) return Eigen::MatrixXd::Identity(d, d);
  const Index a = std::find(parameters.begin(), parameters.end(), about) - parameters.begin();
  return a == d ? Eigen::MatrixXd() : Eigen::MatrixXd(Eigen::MatrixXd::Identity(d, d).row(a));
}

}  // namespace

Decider::Decider(const model::SeparatedModel& model, std::shared_ptr<const model::ObservedModel> observed,
                 const model::Dofs& seen, const likelihood::GaussianNoise& noise,
                 const Eigen::VectorXd& prior_std, const std::vector<ForecastSpecification>& forecasts,
                 DecisionOptions options)
    : options_(std::move(options)),
      time_(observed->time),
      end_(time_.size() - 1),
      failure_specification_(failure_of(forecasts, options_)),
      failure_(model, seen, failure_specification_),
      about_(parameters_about(observed->parameters, options_.about)),
      prior_std_(prior_std),
      information_(std::move(observed), noise),
      loading_(model::loading_of(model, "", std::vector<double>(model.dimension()))) {
  for (const double increment : options_.increments) require_step(increment);
  if (options_.end) end_ = locate_horizon(time_, *options_.end, "decide.end").lower;
  if (about_.size() > 0) return;
  const ForecastSpecification* forecast = find_forecast(forecasts, options_.about);
  if (forecast == nullptr) {
    std::vector<std::string> names = model.parameter_names();
    for (const std::string& name : forecast_names(forecasts)) names.push_back(name);
    throw ProjectError(
        fmt::format("[decide.about] \"{}\" is neither a parameter nor a forecast{}; there are: {}",
                    options_.about, did_you_mean(options_.about, names), fmt::join(names, ", ")));
  }
  learnt_.emplace(model, seen, *forecast);
  learnt_step_ = locate_horizon(time_, forecast->horizon, forecast->name).upper;
}

Decision Decider::decide(const UpdateResult& posterior, const Eigen::MatrixXd& data) {
  Decision decision;
  decision.time = decision.furthest = posterior.time;
  if (posterior.verdict.level == VerdictLevel::reject) {
    decision.action = Action::hold;
    decision.message = "the verdict is reject: do not load on; measure again, or stop and look";
    put_load(decision);
    return decision;
  }
  const Eigen::MatrixXd draws = likelihood::equally_likely(posterior.points, posterior.weights);
  const std::size_t now = present(posterior.time);
  const std::vector<double> risk = risk_from(posterior, draws, now);
  std::vector<std::size_t> offered;
  for (std::size_t then = now; then < now + risk.size(); ++then) {
    if (risk[then - now] > allowed(now, then, risk[0])) continue;
    decision.furthest = time_[then];
    if (then == now || is_offered(now, then)) offered.push_back(then);
  }
  look_from(posterior, draws, data);
  const std::vector<PlannedMeasurement> planned = information_.plan(offered, options_.cost);
  const auto first = std::min_element(planned.begin(), planned.end(),
                                      [](const auto& a, const auto& b) { return a.step < b.step; });
  if (first != planned.end()) {
    const std::size_t then = first->step;
    for (const PlannedMeasurement& one : planned) decision.plan.push_back(time_[one.step]);
    std::sort(decision.plan.begin(), decision.plan.end());
    decision.action = then == now ? Action::hold : Action::load;
    if (then != now) decision.time = time_[then];
    decision.information = information_.of(then);
    decision.failure_probability = risk[then - now];
    decision.allowed_probability = allowed(now, then, risk[0]);
  }
  explain(now, risk, decision);
  put_load(decision);
  return decision;
}

/// What is known already, at a few draws.
void Decider::look_from(const UpdateResult& posterior, const Eigen::MatrixXd& draws,
                        const Eigen::MatrixXd& data) {
  const bool by_data = data.rows() == information_.functions();
  const Eigen::MatrixXd known = by_data ? Eigen::MatrixXd(prior_std_.cwiseAbs2().cwiseInverse().asDiagonal())
                                        : Eigen::MatrixXd(posterior.covariance.inverse());
  information_.set(draws(Eigen::seqN(0, draws.rows() / k_every_draw, k_every_draw), Eigen::all), known,
                   by_data ? data : Eigen::MatrixXd(), rows_about(draws));
}

/// ProjectError where the model has no two times that are so far apart.
void Decider::require_step(double increment) const {
  for (std::size_t then = 1; then < time_.size(); ++then)
    for (std::size_t now = 0; now < then; ++now)
      if (is_increment(now, then, increment)) return;
  throw ProjectError(
      fmt::format("[decide.increments] no two times of the model are {} apart; its first two "
                  "are {}",
                  increment, time_.size() > 1 ? time_[1] - time_[0] : 0));
}

bool Decider::is_increment(std::size_t now, std::size_t then, double increment) const {
  return std::abs(time_[now] + increment - time_[then]) <= k_same_time * (time_[then] - time_[then - 1]);
}

/// The model's time at or just before `time`.
std::size_t Decider::present(double time) const {
  const double step = time_.size() > 1 ? (time_.back() - time_.front()) / (std::ssize(time_) - 1) : 1;
  const auto after = std::upper_bound(time_.begin(), time_.end(), time + k_same_time * step);
  return std::max<Index>(after - time_.begin() - 1, 0);
}

/// P(failure by then) of the present time and those after it, up to the first beyond the whole risk.
std::vector<double> Decider::risk_from(const UpdateResult& posterior, const Eigen::MatrixXd& draws,
                                       std::size_t now) const {
  const double threshold = *failure_specification_.threshold;
  const Verdict& verdict = posterior.verdict;
  const double widening =
      std::max(verdict.level == VerdictLevel::caution ? k_caution_width : 0,
               verdict.model_shift_std.size() > 0 ? verdict.model_shift_std.maxCoeff() : 0);
  std::vector<double> by;
  Eigen::VectorXd largest = Eigen::VectorXd::Constant(draws.rows(), -std::numeric_limits<double>::infinity());
  for (std::size_t first = now; first <= end_ || by.empty(); first += k_times_at_once) {
    const Index count = std::min<Index>(k_times_at_once, std::max(end_, now) - first + 1);
    const Eigen::MatrixXd values = failure_.values(draws, first, count);
    for (Index k = 0; k < count; ++k) {
      largest = largest.cwiseMax(values.col(k));
      const double std = std::sqrt((largest.array() - largest.mean()).square().mean());
      // Between the draws the density is that of their kernel.
      const double width =
          std::sqrt(std::pow(kernel_width(std, draws.rows()), 2) + std::pow(widening * std, 2) +
                    std::pow(failure_specification_.model_error_std, 2));
      double probability = 0;
      for (const double value : largest)
        probability += width > 0 ? numerics::normal_cdf((value - threshold) / width) : value > threshold;
      by.push_back(probability / draws.rows());
      if (by.back() > options_.risk) return by;
    }
  }
  return by;
}

/// Largest probability of failure by the time `then`, of a specimen that has failed by now with that of
/// `now`.
double Decider::allowed(std::size_t now, std::size_t then, double failed) const {
  const double whole = time_[end_] - time_[0];
  const double share = whole > 0 ? (time_[then] - time_[now]) / whole : 0;
  return std::min(options_.risk, failed + options_.risk * share);
}

bool Decider::is_offered(std::size_t now, std::size_t then) const {
  if (options_.increments.empty()) return true;
  return std::any_of(options_.increments.begin(), options_.increments.end(),
                     [&](double increment) { return is_increment(now, then, increment); });
}

/// B: of a forecast its gradient, by regression over the posterior.
Eigen::MatrixXd Decider::rows_about(const Eigen::MatrixXd& draws) const {
  if (!learnt_) return about_;
  const Eigen::VectorXd values = learnt_->values(draws, learnt_step_, 1);
  const Eigen::MatrixXd centred = draws.rowwise() - draws.colwise().mean();
  return centred.colPivHouseholderQr()
      .solve(values.array().matrix() - Eigen::VectorXd::Constant(values.size(), values.mean()))
      .transpose();
}

void Decider::explain(std::size_t now, const std::vector<double>& risk, Decision& decision) const {
  const std::string failure = failure_in_words(failure_specification_, failure_.units());
  if (decision.action != Action::stop) {
    decision.message = fmt::format("{:.2g} nats are expected, the first of {} worth making",
                                   decision.information, counted(decision.plan.size(), "measurement"));
    if (decision.action == Action::load)
      decision.message +=
          fmt::format("; P({}) is {}, {} is allowed", failure, percent(decision.failure_probability),
                      percent(decision.allowed_probability));
    return;
  }
  decision.failure_probability = risk[0];
  decision.allowed_probability = allowed(now, now, risk[0]);
  if (risk[0] > options_.risk)
    decision.message = fmt::format("P({}) is {} already, of {} allowed in the whole test", failure,
                                   percent(risk[0]), percent(options_.risk));
  else if (now >= end_)
    decision.message = "the load is at its end, and another measurement tells too little";
  else if (risk.size() > 1 && risk[1] > allowed(now, now + 1, risk[0]))
    decision.message = fmt::format(
        "P({}) would be {} after the next step of load, {} is allowed; another measurement here "
        "tells too little",
        failure, percent(risk[1]), percent(allowed(now, now + 1, risk[0])));
  else
    decision.message = fmt::format("no measurement that the risk allows tells {} nats", options_.cost);
}

void Decider::put_load(Decision& decision) const {
  if (!loading_) return;
  decision.load = loading_->at(decision.time);
  decision.load_units = loading_->units;
}

}  // namespace knothe::assimilation
