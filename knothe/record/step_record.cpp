#include "knothe/record/step_record.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "knothe/posterior/quadrature/marginal_density.hpp"
#include "knothe/record/fields.hpp"
#include "knothe/record/json_values.hpp"
#include "knothe/record/physical_parameters.hpp"

namespace knothe::record {

using Json = nlohmann::ordered_json;

Json forecast_record(std::span<const assimilation::NamedForecast> forecasts, bool densities) {
  Json record = Json::object();
  for (const assimilation::NamedForecast& named : forecasts) {
    const assimilation::ScalarForecast& f = named.forecast;
    Json& entry = record[named.name];
    entry = {{"mean", f.mean},
             {"std", f.std},
             {"maximum_a_posteriori", f.maximum_a_posteriori},
             {"probability_above_threshold", f.probability_above_threshold},
             {"probability_below_threshold", 1 - f.probability_above_threshold},
             {"horizon", named.horizon},
             {"past", named.is_past},
             {"threshold", named.threshold},
             {"levels", numerics::k_quantile_levels},
             {"values", f.values},
             {"units", named.units}};
    if (named.bridge_residual_rms) entry["bridge_residual_rms"] = *named.bridge_residual_rms;
    if (densities) entry["density"] = {{"points", f.points}, {"values", f.density}};
  }
  return record;
}

namespace {

/// Innovation and test ratio of the sensors that reported, and those that are not reliable.
Json sensor_record(const assimilation::SensorReport& sensors) {
  Json record = {{"indices", Json::array()},
                 {"innovation", Json::array()},
                 {"test_ratio", Json::array()},
                 {"weight", Json::array()}};
  for (Eigen::Index i = 0; i < sensors.innovation.size(); ++i) {
    if (std::isnan(sensors.innovation[i])) continue;
    record["indices"].push_back(i);
    record["innovation"].push_back(sensors.innovation[i]);
    record["test_ratio"].push_back(sensors.test_ratio[i]);
    record["weight"].push_back(sensors.weight[i]);
  }
  record["rejected"] = sensors.rejected;
  record["stuck"] = sensors.stuck;
  record["absent"] = sensors.absent;
  return record;
}

/// Models that are compared, by file.
Json model_records(const std::vector<assimilation::ComparedModel>& models) {
  Json records = Json::object();
  for (const assimilation::ComparedModel& model : models) {
    records[model.name] = {{"probability", model.probability},
                           {"log_evidence", model.log_evidence},
                           {"log_bayes_factor", model.log_bayes_factor},
                           {"evidence_against", model.scale}};
  }
  return records;
}

/// What to do next. The probabilities where they are known, `load` and `units` where the model knows what is
/// imposed.
Json decision_record(const assimilation::Decision& decision) {
  Json record = {{"action", to_text(decision.action)},  {"time", decision.time},
                 {"information", decision.information}, {"plan", decision.plan},
                 {"furthest", decision.furthest},       {"message", decision.message}};
  if (decision.failure_probability) record["failure_probability"] = *decision.failure_probability;
  if (decision.allowed_probability) record["allowed_probability"] = *decision.allowed_probability;
  if (decision.load) record["load"] = *decision.load, record["units"] = decision.load_units;
  return record;
}

}  // namespace

Json verdict_record(const assimilation::Verdict& verdict) {
  Json reasons = Json::array();
  for (const assimilation::VerdictReason& reason : verdict.reasons) {
    Json entry = {{"code", to_text(reason.part)},
                  {"level", to_text(reason.level)},
                  {"value", reason.value},
                  {"limit", reason.limit},
                  {"message", reason.message}};
    if (reason.cause) entry["cause"] = to_text(*reason.cause);
    reasons.push_back(std::move(entry));
  }
  return {{"level", to_text(verdict.level)},
          {"reasons", std::move(reasons)},
          {"model_shift_std", to_json(verdict.model_shift_std)},
          {"fit_probability", verdict.fit_probability},
          {"edge_mass", to_json(verdict.edge_mass)}};
}

Json step_record(const assimilation::StepResult& result, std::span<const model::Axis> axes) {
  const assimilation::UpdateResult& r = result.update;
  const double forecast_us = result.forecast_us;
  Json record = fields_record(r);
  record["wall_clock"] = utc_text(result.computed_at);
  record["parameters"] = parameter_names(axes);
  record["verdict"] = verdict_record(r.verdict);
  record["bias_correction"] = r.bias_corrected ? "on" : "off";
  record["elapsed_us"] = {{"update", r.elapsed_us.total()},
                          {"forecast", forecast_us},
                          {"total", r.elapsed_us.total() + forecast_us},
                          {"projection", r.elapsed_us.projection},
                          {"map", r.elapsed_us.map},
                          {"correction", r.elapsed_us.correction},
                          {"watch", r.elapsed_us.watch},
                          {"verdict", r.elapsed_us.verdict}};
  record["forecast"] = forecast_record(result.forecasts, false);
  record["physical"] = physical_record(axes, r.mean, r.covariance);
  if (!r.notice.empty()) record["notice"] = r.notice;
  if (!r.remark.empty()) record["remark"] = r.remark;
  if (r.noise_level) record["noise_level"] = *r.noise_level;
  if (result.followed)
    record["monitor"] = {{"probability", r.monitor.upper_probability},
                         {"cumulative_sum", r.monitor.cumulative_sum},
                         {"threshold", r.monitor.threshold},
                         {"alarm", r.monitor.alarm},
                         {"smoothed_increment", r.monitor.smoothed_increment},
                         {"discrepancy", r.monitor.discrepancy}};
  if (result.model_version > 0) record["model_version"] = result.model_version;
  if (result.decision) {
    record["decision"] = decision_record(*result.decision);
    record["elapsed_us"]["decision"] = result.decision_us;
    record["elapsed_us"]["total"] = r.elapsed_us.total() + forecast_us + result.decision_us;
  }
  if (result.sensors) record["sensors"] = sensor_record(*result.sensors);
  if (!result.stuck.empty()) record["stuck"] = result.stuck;
  if (!result.absent.empty()) record["absent"] = result.absent;
  if (!result.scores.empty()) record["scores"] = score_records(result.scores);
  if (!result.models.empty()) record["models"] = model_records(result.models);
  for (const assimilation::EstimatedError& error : result.lasting_errors)
    record["nuisances"][error.name] = {{"mean", error.mean}, {"std", error.std}};
  return record;
}

Json score_records(std::span<const assimilation::ScoredForecast> scores) {
  Json records = Json::object();
  for (const assimilation::ScoredForecast& s : scores) {
    records[s.name] = {
        {"time", s.time}, {"observed", s.observed},   {"std", s.std},   {"units", s.units},
        {"step", s.step}, {"lead_time", s.lead_time}, {"crps", s.crps}, {"probability", s.probability}};
  }
  return records;
}

/// Whether a forecast says what the one of `mean` and `std` says.
bool agree(const assimilation::ScalarForecast& other, double mean, double std) {
  return std::abs(other.mean - mean) <= 0.5 * std && other.std <= 2 * std && std <= 2 * other.std;
}

void add_densities(Json& record, const std::vector<std::string>& parameters,
                   const std::vector<posterior::Prior>& priors, const assimilation::StepResult& result,
                   std::span<const assimilation::NamedForecast> published) {
  const posterior::Posterior& posterior = result.update;
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    const auto marginal = posterior::marginal_density(posterior.points.col(k), posterior.weights, priors[k]);
    record["marginals"][parameters[k]] = {{"points", marginal.points}, {"density", marginal.density}};
  }
  record["forecast"] = forecast_record(result.forecasts, true);
  for (const assimilation::NamedForecast& named : published) {
    Json& headline = record["forecast"][named.name];
    headline["published"] = {{"mean", named.forecast.mean},
                             {"std", named.forecast.std},
                             {"agrees", agree(named.forecast, headline.at("mean"), headline.at("std"))},
                             {"levels", numerics::k_quantile_levels},
                             {"values", named.forecast.values}};
  }
}

}  // namespace knothe::record
