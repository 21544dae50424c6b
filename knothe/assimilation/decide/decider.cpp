#include "knothe/assimilation/decide/decider.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "knothe/assimilation/forecast/forecast_inputs.hpp"
#include "knothe/assimilation/forecast/horizon.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/step/posterior_functions.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::assimilation {
namespace {

constexpr Index k_times_at_once = 8;   // that the risk is looked at
constexpr Index k_max_points = 2048;   // of a posterior; of more so many draws
constexpr double k_no_weight = 1e-12;  // share of all weight
constexpr double k_no_spread = 1e-12;  // share of a quantity
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

/// Points of a posterior with weights that add up to 1: rare ones count as well as those in the middle.
struct Sample {
  Eigen::MatrixXd points;   ///< n × d
  Eigen::VectorXd weights;  ///< n

  [[nodiscard]] double mean(const Eigen::VectorXd& values) const { return weights.dot(values); }
  [[nodiscard]] double std(const Eigen::VectorXd& values) const {
    return std::sqrt(weights.dot((values.array() - mean(values)).square().matrix()));
  }
};

/// The gradient of a quantity over a posterior, by least squares.
class Regression {
 public:
  explicit Regression(const Sample& sample) : root_(sample.weights.cwiseSqrt()) {
    const Eigen::RowVectorXd mean = sample.weights.transpose() * sample.points;
    centred_.compute(root_.asDiagonal() * (sample.points.rowwise() - mean));
  }

  /// `values`: of each point. Adding a constant to them changes nothing.
  [[nodiscard]] Eigen::VectorXd of(const Eigen::VectorXd& values) const {
    const double mean = root_.cwiseAbs2().dot(values);
    return centred_.solve(root_.cwiseProduct((values.array() - mean).matrix()));
  }

 private:
  Eigen::VectorXd root_;  ///< of the weights
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> centred_;
};

Sample equal_weights(const Eigen::MatrixXd& points) {
  return {points, Eigen::VectorXd::Constant(points.rows(), 1.0 / points.rows())};
}

Sample sample_of(const UpdateResult& posterior) {
  const double least = k_no_weight * posterior.weights.sum();
  std::vector<Index> kept;
  for (Index i = 0; i < posterior.weights.size(); ++i)
    if (posterior.weights[i] > least) kept.push_back(i);
  if (kept.empty()) throw NumericalError("no point of the posterior has a weight");
  if (std::ssize(kept) > k_max_points)
    return equal_weights(
        posterior.points(numerics::equal_draws(posterior.weights, k_max_points), Eigen::all));
  const Eigen::VectorXd weights = posterior.weights(kept);
  return {posterior.points(kept, Eigen::all), weights / weights.sum()};
}

/// Silverman's, of values without outliers; `count`: the effective number of points.
double kernel_width(double std, double count) {
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
      units_(forecast_units(model.contents(), failure_specification_)),
      failure_(model, seen, failure_specification_),
      about_(parameters_about(observed->parameters, options_.about)),
      prior_std_(prior_std),
      information_(std::move(observed), noise),
      loading_(model::loading_of(model, "", std::vector<double>(model.dimension()))) {
  for (const double increment : options_.increments) require_step(increment);
  if (options_.end) end_ = locate_horizon(time_, *options_.end, "[decide] end").lower;
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
  horizon_ = locate_horizon(time_, forecast->horizon, fmt::format("[forecast.{}] horizon", forecast->name));
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
  const std::vector<double> risk = risk_from(posterior, now);
  std::vector<std::size_t> offered;
  for (std::size_t then = now; then < now + risk.size(); ++then) {
    if (risk[then - now] > allowed(posterior.time, then, risk[0])) continue;
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
    decision.allowed_probability = allowed(posterior.time, then, risk[0]);
  } else {
    decision.failure_probability = risk[0];
    decision.allowed_probability = allowed(posterior.time, now, risk[0]);
  }
  explain(now, risk, decision);
  put_load(decision);
  return decision;
}

/// What is known already, at a few draws: Λ times an unknown noise level, which does not change what a
/// measurement of nominal noise tells.
void Decider::look_from(const UpdateResult& posterior, const Eigen::MatrixXd& draws,
                        const Eigen::MatrixXd& data) {
  const bool by_data = data.rows() == information_.functions();
  const Eigen::MatrixXd known = by_data ? Eigen::MatrixXd(prior_std_.cwiseAbs2().cwiseInverse().asDiagonal())
                                        : Eigen::MatrixXd(posterior.covariance.inverse());
  information_.set(draws(Eigen::seqN(0, draws.rows() / k_every_draw, k_every_draw), Eigen::all),
                   posterior.noise_level.value_or(1.0) * known, by_data ? data : Eigen::MatrixXd(),
                   rows_about(draws));
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
std::vector<double> Decider::risk_from(const UpdateResult& posterior, std::size_t now) const {
  const double threshold = *failure_specification_.threshold;
  const Verdict& verdict = posterior.verdict;
  const double caution = verdict.level == VerdictLevel::caution ? k_caution_width : 0;
  const Eigen::VectorXd shift =  // of each parameter, as far as the reduced model may move it
      verdict.model_shift_std.size() > 0
          ? Eigen::VectorXd(verdict.model_shift_std.cwiseAbs().cwiseProduct(posterior.standard_deviations()))
          : Eigen::VectorXd::Zero(posterior.points.cols());
  const Sample sample = sample_of(posterior);
  const Regression gradient(sample);
  const double count_of_points = 1 / sample.weights.squaredNorm();
  std::vector<double> by;
  Eigen::VectorXd largest =
      Eigen::VectorXd::Constant(sample.weights.size(), -std::numeric_limits<double>::infinity());
  for (std::size_t first = now; first <= end_ || by.empty(); first += k_times_at_once) {
    const Index count = std::min<Index>(k_times_at_once, std::max(end_, now) - first + 1);
    const Eigen::MatrixXd values = failure_.values(sample.points, first, count);
    for (Index k = 0; k < count; ++k) {
      largest = largest.cwiseMax(values.col(k));
      const double std = sample.std(largest);
      // Between the points the density is that of their kernel.
      const double width =
          std::sqrt(std::pow(kernel_width(std, count_of_points), 2) + std::pow(caution * std, 2) +
                    std::pow(gradient.of(largest).cwiseAbs().dot(shift), 2) +
                    std::pow(failure_specification_.model_error_std, 2));
      by.push_back(sample.mean(largest.unaryExpr([&](double value) {
        return width == 0 ? 1.0 * (value > threshold) : numerics::normal_cdf((value - threshold) / width);
      })));
      if (!std::isfinite(by.back()))
        throw NumericalError(
            fmt::format("P({}) is not finite", failure_in_words(failure_specification_, units_)));
      if (by.back() > options_.risk) return by;
    }
  }
  return by;
}

/// Largest probability of failure by the time `then`, of a specimen that has failed by `present` with that of
/// `failed`.
double Decider::allowed(double present, std::size_t then, double failed) const {
  const double whole = time_[end_] - time_[0];
  const double share = whole > 0 ? std::max(0.0, time_[then] - present) / whole : 0;
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
  const Eigen::MatrixXd beside = learnt_->values(draws, horizon_.lower, horizon_.upper - horizon_.lower + 1);
  const Eigen::VectorXd values =
      horizon_.interpolate<Eigen::VectorXd>(beside.leftCols<1>(), beside.rightCols<1>());
  const Sample sample = equal_weights(draws);
  if (!(sample.std(values) > k_no_spread * values.cwiseAbs().maxCoeff()))
    return Eigen::RowVectorXd::Zero(draws.cols());  // it does not depend on them
  return Regression(sample).of(values).transpose();
}

void Decider::explain(std::size_t now, const std::vector<double>& risk, Decision& decision) const {
  const std::string failure = failure_in_words(failure_specification_, units_);
  if (decision.action != Action::stop) {
    decision.message = fmt::format("{:.2g} nats are expected, the first of {} worth making",
                                   decision.information, counted(decision.plan.size(), "measurement"));
    if (decision.action == Action::load)
      decision.message +=
          fmt::format("; P({}) is {}, {} is allowed", failure, percent(*decision.failure_probability),
                      percent(*decision.allowed_probability));
    return;
  }
  if (risk[0] > options_.risk)
    decision.message = fmt::format("P({}) is {} already, of {} allowed in the whole test", failure,
                                   percent(risk[0]), percent(options_.risk));
  else if (now >= end_)
    decision.message = "the load is at its end, and another measurement tells too little";
  else if (risk.size() > 1 && risk[1] > allowed(decision.time, now + 1, risk[0]))
    decision.message = fmt::format(
        "P({}) would be {} after the next step of load, {} is allowed; another measurement here "
        "tells too little",
        failure, percent(risk[1]), percent(allowed(decision.time, now + 1, risk[0])));
  else
    decision.message = fmt::format("no measurement that the risk allows tells {} nats", options_.cost);
}

void Decider::put_load(Decision& decision) const {
  decision.load = loading_.at(decision.time);
  decision.load_units = loading_.units, decision.time_units = loading_.time_units;
}

}  // namespace knothe::assimilation
