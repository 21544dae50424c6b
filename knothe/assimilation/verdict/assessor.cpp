#include "knothe/assimilation/verdict/assessor.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "knothe/assimilation/verdict/edge_pressure.hpp"
#include "knothe/assimilation/verdict/parameter_change.hpp"
#include "knothe/assimilation/verdict/prior_conflict.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/numerics/statistics/chi_squared.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

/// Φ⁻¹(F_ν(t)): the score of a Student-t value.
double normal_score(double t, double degrees) {
  const boost::math::students_t distribution(degrees);
  const double z = numerics::normal_quantile(boost::math::cdf(distribution, -std::abs(t)));
  return std::copysign(std::max(z, -38.0), t);
}

/// A count with commas between thousands.
std::string with_commas(double count) {
  std::string text = fmt::format("{:.0f}", count);
  for (auto i = std::ssize(text) - 3; i > 0; i -= 3) text.insert(i, ",");
  return text;
}

/// Whether a data error has been named, which no correction of the model repairs.
bool has_cause(const Verdict& verdict) {
  return std::any_of(verdict.reasons.begin(), verdict.reasons.end(), [](const VerdictReason& reason) {
    return reason.cause && *reason.cause != MisfitCause::unknown;
  });
}

/// Where a few values stand out and the others fit: in words, else nothing.
std::optional<std::string> few_that_stand_out(const ResidualReport& report, double limit) {
  constexpr double k_far = 4.5, k_max_share = 0.01;
  const Eigen::ArrayXXd size = report.scores.array().abs();
  const double values = (size > 0).count(), far = (size > k_far).count();
  if (far == 0 || far > std::max(1.0, k_max_share * values) || far == values) return std::nullopt;
  const double others = (size > k_far).select(0.0, size).square().sum();
  if (numerics::chi_squared_upper(others, values - far) < limit) return std::nullopt;
  return fmt::format(
      "{} of {} values stand out, by up to {:.3g} standard deviations, and the others fit: find out what is "
      "wrong there, or leave them out (method.gate; of exported fields data.fields.outliers)",
      far, values, size.maxCoeff());
}

}  // namespace

Assessor::Assessor(std::shared_ptr<const model::ObservedModel> model, likelihood::NoiseModel noise,
                   const std::vector<posterior::Prior>& priors, model::Sensors sensors,
                   likelihood::RobustOptions robust, model::ObservedErrors errors,
                   const MonitorOptions& monitor, std::vector<model::Axis> axes, VerdictOptions options)
    : model_(std::move(model)),
      priors_(priors),
      axes_(std::move(axes)),
      robust_(robust),
      errors_(std::move(errors)),
      monitor_(monitor),
      options_(options),
      tests_(model_, std::move(noise), std::move(sensors)) {
  for (std::size_t a = axes_.size(); a < priors.size(); ++a)
    axes_.emplace_back().name = a < model_->parameters.size() ? model_->parameters[a] : fmt::format("p{}", a);
  model::FunctionBatch centre;
  centre.resize(1, priors_.dimension(), model_->functions->count(), 0);
  model_->functions->evaluate(likelihood::medians(priors_).transpose(), 0, centre);
  central_ = centre.value.row(0).transpose();
  if (errors_.count() == 0) return;
  if (errors_.points.size() > 0) shift_.emplace(*model_, errors_, priors_);
  const Eigen::MatrixXd weighted =
      model_->space.transpose() * tests_.noise().measurement().apply(errors_.space);
  for (std::size_t t = 0; t < model_->core.size(); ++t)
    projected_.push_back(model_->core[t].transpose() * (weighted * errors_.coefficients[t]));
}

Verdict Assessor::assess(const AssessedPosterior& posterior, const AssessedData& data) {
  Verdict verdict;
  if (posterior.latest != nullptr) verdict.latest = misfit_of(*posterior.latest, posterior);
  assess_computation(posterior.update, verdict);
  assess_fit(posterior, data, verdict);
  const PriorConflict conflict = find_prior_conflict(priors_, posterior.update);
  std::optional<VerdictReason> of_prior = conflict_reason(conflict, priors_, axes_);
  if (!of_prior) of_prior = not_told_apart(conflict, priors_, axes_);
  if (of_prior) verdict.add(std::move(*of_prior));
  assess_range(posterior.update, verdict);
  assess_model(posterior, data, verdict);
  assess_sensors(posterior, verdict);
  return verdict;
}

void Assessor::assess_computation(const UpdateResult& update, Verdict& verdict) const {
  if (update.trusted || update.by_quadrature) return;
  verdict.add({VerdictPart::computation,
               VerdictLevel::caution,
               update.variance_diagnostic,
               0.05,
               update.remark.empty() ? "the computed posterior is not verified" : update.remark,
               {}});
}

/// χ² of the data of a form at the mean of w.
Misfit Assessor::misfit_of(const likelihood::StepForm& form, const AssessedPosterior& posterior) const {
  const Eigen::VectorXd v = posterior.functions.mean - central_;
  const double chi_squared = form.constant - 2 * form.linear.dot(v) + v.dot(form.quadratic * v);
  Misfit misfit{std::max(0.0, chi_squared) / posterior.update.noise_level.value_or(1.0), form.used};
  if (misfit.values > 0) misfit.probability = numerics::chi_squared_upper(misfit.statistic, misfit.values);
  return misfit;
}

ResidualReport Assessor::examine(const AssessedPosterior& posterior,
                                 std::span<const likelihood::DatumPointer> data) {
  const Index parameters = priors_.dimension();
  ResidualReport report =
      tests_.examine(data, posterior.functions.mean, posterior.update.noise_level.value_or(1.0), parameters,
                     posterior.lasting_errors);
  if (robust_.is_active() && tests_.noise().measurement().is_independent()) {
    Eigen::MatrixXd scores = report.scores;
    if (robust_.gate > 0) {
      scores = (scores.array().abs() > robust_.gate).select(0.0, scores);
    } else {
      const double degrees = robust_.degrees_of_freedom;
      scores = scores.unaryExpr([degrees](double t) { return t == 0 ? 0.0 : normal_score(t, degrees); });
    }
    ResidualReport judged = tests_.examine_scores(std::move(scores), parameters);
    // A Student-t likelihood is for noise that is normal but for some values, too: only against that can
    // values be too small.
    if (robust_.degrees_of_freedom > 0)
      judged.set(ResidualTest::too_small, report.of(ResidualTest::too_small));
    if (!likelihood::links_steps(tests_.noise())) return judged;
    report = std::move(judged);
  }
  if (posterior.all_data == nullptr) return report;
  // All data, also those whose residuals are no longer looked at, and errors that steps share eliminated.
  const Misfit all = misfit_of(posterior.all_data->form, posterior);
  report.misfit = all.statistic;
  report.values = all.values;
  report.set(ResidualTest::total, all.probability);
  return report;
}

/// The data less what they say of the errors they have together, which no cause is to be found for.
std::vector<likelihood::DatumPointer> Assessor::without_lasting_errors(
    const AssessedPosterior& posterior, std::span<const likelihood::DatumPointer> data) const {
  std::vector<likelihood::DatumPointer> others(data.begin(), data.end());
  if (posterior.lasting_errors.empty()) return others;
  for (likelihood::DatumPointer& datum : others) {
    auto without = std::make_shared<likelihood::Datum>(*datum);
    without->values -= expected_error(tests_.noise().lasting(), datum->step, posterior.lasting_errors);
    datum = std::move(without);
  }
  return others;
}

void Assessor::test_constancy(const AssessedPosterior& posterior, const AssessedData& data,
                              ResidualReport& report) const {
  if (posterior.all_data == nullptr) return;
  const ParameterChange change =
      find_parameter_change(posterior.all_data->blocks, posterior.functions.mean - central_,
                            posterior.functions.tangent, posterior.update.noise_level.value_or(1.0));
  if (change.probability >= options_.fit_caution)  // nobody asks where
    return report.set(ResidualTest::constancy, change.probability);
  if (const auto step = data.step_after(change.after))
    report.set(ResidualTest::constancy, change.probability, *step);
}

/// Whether a series asks for the parameters that all data ask for.
void Assessor::test_agreement(const AssessedPosterior& posterior,
                              std::span<const likelihood::DatumPointer> examined,
                              ResidualReport& report) const {
  if (posterior.all_data == nullptr) return;
  const Eigen::MatrixXd& tangent = posterior.functions.tangent;
  std::vector<Eigen::MatrixXd> series = tests_.said_by_series(examined, report, tangent);
  if (series.empty()) return;
  const double level = posterior.update.noise_level.value_or(1.0);
  const Eigen::MatrixXd all =
      said_of_parameters(posterior.all_data->form, posterior.functions.mean - central_, tangent);
  for (Index s = 0; s < std::ssize(series); ++s) {
    series[s].rightCols(1) *= std::sqrt(level);  // of scores in the noise's true standard deviations
    const double probability = std::min(1.0, std::ssize(series) * probability_of_part(series[s], all, level));
    if (probability < report.of(ResidualTest::agreement))
      report.set(ResidualTest::agreement, probability, tests_.noise().size() - std::ssize(series) + s);
  }
}

std::string Assessor::misfit_in_words(const ResidualReport& report,
                                      std::span<const likelihood::DatumPointer> data) const {
  const ResidualTest worst = report.worst(options_.fit_caution);
  const Index at = report.at[static_cast<std::size_t>(worst)];
  switch (worst) {
    case ResidualTest::total:
      return fmt::format("the data do not fit the model: χ² is {:.4g} for {} values", report.misfit,
                         report.values);
    case ResidualTest::too_small:
      return fmt::format("the data fit better than their noise allows: χ² is {:.4g} for {} values",
                         report.misfit, report.values);
    case ResidualTest::group:
      return fmt::format("the values of {} do not fit the model", tests_.group_names()[at]);
    case ResidualTest::sensor:
    case ResidualTest::sensor_mean:
      return fmt::format("{} does not fit the model", tests_.name_of(at));
    case ResidualTest::value:
      return fmt::format("the value of {} at step {} does not fit the model",
                         tests_.name_of(at % report.scores.rows()), data[at / report.scores.rows()]->step);
    case ResidualTest::step:
      return fmt::format("the data of step {} do not fit the model", data[at]->step);
    case ResidualTest::modes:
    case ResidualTest::modes_mean:
    case ResidualTest::modes_slow:
      return fmt::format("the residuals have the shape of displacements, not of noise{}",
                         report.of(ResidualTest::time_neighbours) < options_.fit_caution
                             ? " (they are correlated from step to step: the model is wrong, or the noise is "
                               "not independent)"
                             : "");
    case ResidualTest::agreement:
      return fmt::format(
          "{} and the other data ask for different parameters: one of them, or the model, is wrong",
          tests_.name_of(at));
    case ResidualTest::constancy:
      return fmt::format(
          "the data before step {} and those from it on ask for different parameters: the structure changed "
          "(method.change_points = [{}] forgets what was before), or the model is wrong",
          at, at);
    case ResidualTest::time_neighbours:
      return "residuals that follow each other are correlated: the noise is not independent from step to "
             "step as stated, or something slow is not in the model; the intervals are too narrow";
    case ResidualTest::space_neighbours:
      return "residuals of neighbouring sensors are correlated: the noise is not independent from sensor to "
             "sensor as stated; the intervals are too narrow";
    case ResidualTest::repeated:
      return fmt::format(
          "step {} repeats the values of a datum before it to the last digits: it was stored twice; withdraw "
          "it",
          data[at]->step);
  }
  return {};
}

void Assessor::assess_fit(const AssessedPosterior& posterior, const AssessedData& data, Verdict& verdict) {
  if (posterior.corrected || data.empty()) return;  // the correction takes up what is left over
  const auto examined = data.last(options_.examined);
  ResidualReport report = examine(posterior, examined);
  test_constancy(posterior, data, report);
  test_agreement(posterior, examined, report);
  verdict.fit_probability = report.of(ResidualTest::total);
  if (!report.fails(options_.fit_caution)) return;
  const ResidualTest worst = report.worst(options_.fit_caution);
  VerdictReason reason{VerdictPart::fit,
                       VerdictLevel::caution,
                       report.of(worst),
                       options_.fit_caution,
                       misfit_in_words(report, examined),
                       MisfitCause::unknown,
                       is_about_noise(worst)};
  bool grave = reason.value < options_.fit_reject && !is_about_noise(worst);
  if (worst != ResidualTest::repeated) {
    const Diagnosis found = diagnose(*model_, tests_, priors_, without_lasting_errors(posterior, examined),
                                     posterior.update.mean, report, options_.fit_caution);
    reason.cause = found.cause;
    const auto few =
        found.cause == MisfitCause::unknown ? few_that_stand_out(report, options_.fit_caution) : std::nullopt;
    if (found.cause == MisfitCause::noise_level) grave = found.factor > 1.5;
    if (!is_about_noise(worst) || found.cause != MisfitCause::unknown)
      reason.message +=
          (reason.message.find(": ") == std::string::npos ? ": " : "; ") + few.value_or(found.message);
  }
  if (grave) reason.level = VerdictLevel::reject;
  verdict.add(std::move(reason));
}

void Assessor::assess_range(const UpdateResult& update, Verdict& verdict) const {
  const Index d = update.mean.size();
  verdict.edge_mass = Eigen::VectorXd::Zero(d);
  for (Index a = 0; a < d; ++a) {
    const posterior::Prior& prior = priors_.prior(a);
    const double lower = prior.lower(), upper = prior.upper();
    if (!std::isfinite(lower) || !std::isfinite(upper)) continue;
    const double outer = 0.02 * (upper - lower);
    for (Index k = 0; k < update.weights.size(); ++k)
      if (update.points(k, a) < lower + outer || update.points(k, a) > upper - outer)
        verdict.edge_mass[a] += update.weights[k];
    const double low = edge_pressure(update, a, lower), high = edge_pressure(update, a, upper);
    const bool at_lower = low > high;
    const double edge = at_lower ? lower : upper, found = std::max(low, high);
    const double inside = probability_inside(found, std::sqrt(update.covariance(a, a)) / (upper - lower));
    if (found < options_.edge_caution && inside > options_.outside_caution) continue;
    verdict.add(
        {VerdictPart::range,
         found > options_.edge_reject ? VerdictLevel::reject : VerdictLevel::caution,
         found,
         options_.edge_caution,
         fmt::format("{} is pressed against the {} end of the model's range: the data favour values {} "
                     "{:.4g}; make the model with a wider range, or find out why they do",
                     name_of_parameter(a), at_lower ? "lower" : "upper", at_lower ? "below" : "above", edge),
         {}});
  }
}

/// Of the values that are there; with correlated noise, as if all were.
Eigen::MatrixXd Assessor::projected_errors(const likelihood::Datum& datum) const {
  const Eigen::MatrixXd* step_error = tests_.noise().step_error(datum.step);
  const bool own =
      datum.noise || likelihood::has_own_noise(tests_.noise(), datum.step) || step_error != nullptr;
  const likelihood::GaussianNoise& noise = datum.noise ? *datum.noise : tests_.noise().at_step(datum.step);
  const bool complete = !noise.is_independent() || !datum.values.hasNaN();
  if (complete && !own) return projected_[datum.time_index];
  Eigen::MatrixXd errors = errors_.space * errors_.coefficients[datum.time_index];
  if (!complete)
    for (Eigen::Index i = 0; i < errors.rows(); ++i)
      if (std::isnan(datum.values[i])) errors.row(i).setZero();
  const Eigen::MatrixXd weighted =
      step_error == nullptr ? noise.apply(errors) : likelihood::apply_with_error(noise, *step_error, errors);
  return model_->core[datum.time_index].transpose() * (model_->space.transpose() * weighted);
}

void Assessor::forget_from(std::size_t step) {
  sums_before_.forget_after(step);
  if (!sum_.last_step || step > *sum_.last_step) return;
  const auto* milestone = sums_before_.last_up_to(step);
  sum_ = milestone != nullptr ? milestone->second : Sum();
}

/// The sum of the errors of all data; goes on from where it was.
void Assessor::sum_errors(const AssessedData& data) {
  if (sum_.last_step && *sum_.last_step > data.last_step()) forget_from(data.last_step() + 1);
  if (!sum_.last_step) sum_.errors = Eigen::MatrixXd::Zero(model_->functions->count(), errors_.count());
  data.for_each(sum_.last_step, [&](const likelihood::DatumPointer& datum) {
    if (sum_.last_step && *sum_.last_step < datum->step && sums_before_.wants(datum->step))
      sums_before_.save(datum->step, sum_);
    sum_.errors += projected_errors(*datum);
    sum_.last_step = datum->step;
  });
}

/// How much each known error says of the model's error over the posterior, adding up to one: of one that
/// speaks for its surroundings the density of those at the posterior, of one that speaks for the whole box
/// the uniform one, times how alike it is there.
Eigen::VectorXd Assessor::relevance_of_errors(const UpdateResult& update) const {
  Eigen::VectorXd logarithm = Eigen::VectorXd::Zero(errors_.count());
  if (errors_.points.size() == 0 || (errors_.reach.isZero(0) && errors_.alike.size() == 0))
    return Eigen::VectorXd::Constant(errors_.count(), 1.0 / errors_.count());
  const auto log_normal = [](double away, double variance) {
    return -0.5 * (away * away / variance + std::log(2 * M_PI * variance));
  };
  // Of Σ e ln p, where errors that are alike are told by it: the range over the box, the posterior's
  // variance.
  double range = 0, spread = errors_.alike_within * errors_.alike_within;
  if (errors_.alike.size() > 0) {
    const Eigen::VectorXd slope = errors_.alike.cwiseQuotient(update.mean);
    spread += slope.dot(update.covariance * slope);
    for (Index a = 0; a < priors_.dimension(); ++a)
      range += std::abs(errors_.alike[a]) * std::log(priors_.prior(a).upper() / priors_.prior(a).lower());
  }
  for (Index j = 0; j < errors_.count(); ++j) {
    for (Index a = 0; a < priors_.dimension(); ++a) {
      const double reach = errors_.reach(j, a);
      logarithm[j] += reach > 0 ? log_normal(update.mean[a] - errors_.points(j, a),
                                             update.covariance(a, a) + reach * reach)
                                : -std::log(priors_.prior(a).upper() - priors_.prior(a).lower());
    }
    if (!(range > 0) || std::isinf(range) || !errors_.reach.row(j).isZero(0)) continue;
    const Eigen::VectorXd ratio = update.mean.cwiseQuotient(errors_.points.row(j).transpose());
    logarithm[j] += std::log(range) + log_normal(errors_.alike.dot(ratio.array().log().matrix()), spread);
  }
  const Eigen::VectorXd density = (logarithm.array() - logarithm.maxCoeff()).exp();
  return density / density.sum();
}

/// Of d × k shifts by each known error, in standard deviations, the root mean square that counts here.
Eigen::VectorXd Assessor::mean_shift(const Eigen::MatrixXd& shifts, const UpdateResult& update) const {
  return (shifts.cwiseAbs2() * relevance_of_errors(update)).cwiseSqrt();
}

/// Two looks. An error carried to the posterior: the exact log-likelihood differs from the reduced model's by
/// a constant − w(p)ᵀ h, h = Σ (U C_t)ᵀ R⁻¹ e(t), as far as e does not change over the posterior, and the
/// mean moves by −Cov(p, w) h; with the regression Cov(w, p) L⁻ᵀ = T, L Lᵀ = Cov(p), that is −L Tᵀ h. And
/// where it is known at which parameters each error was found: the model fitted there (`ModelShift`).
void Assessor::assess_model(const AssessedPosterior& posterior, const AssessedData& data, Verdict& verdict) {
  if (errors_.count() == 0 || data.empty()) return;
  sum_errors(data);
  const UpdateResult& update = posterior.update;
  const double level = update.noise_level.value_or(1.0);
  const Eigen::MatrixXd errors = sum_.errors / level;
  const Eigen::LLT<Eigen::MatrixXd> factor(update.covariance);
  if (factor.info() != Eigen::Success) return;
  const Eigen::VectorXd carried =
      mean_shift(factor.matrixL() * (posterior.functions.tangent.transpose() * errors), update)
          .cwiseQuotient(update.standard_deviations());
  const Eigen::VectorXd fitted =
      shift_ && posterior.all_data != nullptr
          ? mean_shift(shift_->of(posterior.all_data->form.quadratic / level, errors), update)
          : Eigen::VectorXd::Zero(carried.size());
  verdict.model_shift_std = carried.cwiseMax(fitted);
  if (fitted.maxCoeff() / options_.fitted_caution > carried.maxCoeff() / options_.carried_caution) {
    add_model_reason(fitted, options_.fitted_caution, options_.fitted_reject, verdict);
  } else {
    add_model_reason(carried, options_.carried_caution, options_.carried_reject, verdict);
  }
}

void Assessor::add_model_reason(const Eigen::VectorXd& shift, double caution, double reject,
                                Verdict& verdict) const {
  Index worst = 0;
  const double largest = shift.maxCoeff(&worst);
  if (largest < caution) return;
  verdict.add(
      {VerdictPart::model,
       largest > reject ? VerdictLevel::reject : VerdictLevel::caution,
       largest,
       caution,
       fmt::format(
           "the error of the reduced model shifts {} by about {:.2g} posterior standard deviations "
           "(estimated from its errors at {} points off the grid): {}build a finer model",
           name_of_parameter(worst), largest, errors_.count(),
           // An error of each step: the model's own is in the noise already, and verify does not go with it.
           tests_.noise().has_step_errors()
               ? ""
               : "set method.verify = \"full-order\" (or truncation_error = \"on\"), or "),
       {}});
}

void Assessor::assess_sensors(const AssessedPosterior& posterior, Verdict& verdict) const {
  const UpdateResult& update = posterior.update;
  if (update.monitor.alarm)
    verdict.add(
        {VerdictPart::bias,
         VerdictLevel::caution,
         update.monitor.cumulative_sum,
         update.monitor.threshold,
         fmt::format(
             "the model does not predict the data: drift detected; by chance once in {} steps{}",
             with_commas(monitor_.average_run_length),
             posterior.corrected || has_cause(verdict) ? "" : "; bias_correction = \"auto\" allows for it"),
         {}});
  if (posterior.corrected)
    verdict.add({VerdictPart::bias,
                 VerdictLevel::caution,
                 update.monitor.discrepancy,
                 0,
                 "the model alone does not explain the data: bias correction was applied at some steps",
                 {}});
  const double reported = update.used + update.rejected;
  const double share = reported > 0 ? update.rejected / reported : 0;
  if (share > options_.rejected_values)
    verdict.add(
        {VerdictPart::outlier,
         VerdictLevel::caution,
         share,
         options_.rejected_values,
         fmt::format("{} of {:.0f} values of this step were rejected as outliers", update.rejected, reported),
         {}});
  if (!posterior.stuck.empty())
    verdict.add({VerdictPart::outlier,
                 VerdictLevel::caution,
                 static_cast<double>(posterior.stuck.size()),
                 0,
                 fmt::format("{} reports the same value again and again while the model moves: leave it out",
                             tests_.name_of(posterior.stuck[0])),
                 {}});
}

}  // namespace knothe::assimilation
