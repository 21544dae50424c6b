#include "knothe/record/fields.hpp"

#include <fmt/format.h>

#include <string_view>
#include <type_traits>

#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/record/json_values.hpp"

namespace knothe::record {
namespace {

using Json = nlohmann::ordered_json;
using assimilation::InferenceResult;
using assimilation::UpdateResult;

constexpr std::string_view k_step_number = "step";

/// What every way of inference says of its posterior: keys of both lists.
template <class R>
struct Common {
  static constexpr Field<R> mean{"mean", &R::mean, "mean of each parameter"},
      covariance{"covariance", &R::covariance, "of the parameters, by rows"},
      mode{"maximum_a_posteriori", &R::maximum_a_posteriori,
           "where the density of the parameters is largest"},
      quantiles{"quantiles", Made{"object"}, "levels, and values by parameter"},
      method{"method", Made{"string"}, "that made the weighted points"},
      parameters{"parameters", Made{"array"}, "names, in the order of all lists"},
      wall_clock{"wall_clock", Made{"string"}, "when it was computed, UTC"},
      order{"map_order", &R::map_order, "order of the map, 0 without one"},
      diagnostic{"variance_diagnostic", &R::variance_diagnostic,
                 "verified variance diagnostic, 0 without a map"},
      tolerance{"tolerance_reached", &R::tolerance_reached, "1 if the tolerance was reached"},
      ess{"ess", &R::effective_sample_size, "effective sample size as a fraction of the weighted points"},
      trusted{"trusted", &R::trusted, "1 if the computation is trusted"},
      evidence{"log_evidence", &R::log_evidence, "natural logarithm of the evidence of all data"},
      elapsed{"elapsed_us", Made{"object"}, "time of each phase, µs"},
      physical{"physical", Made{"object"}, "mean and std of each parameter in physical units"};
};

/// `action(value, field)` for each field that the result has itself.
template <class Result, class Of, class Action>
void for_each(std::span<const Field<Of>> fields, Result& result, const Action& action) {
  for (const Field<Of>& field : fields) {
    const auto call = [&](const auto member) {
      if constexpr (!std::is_same_v<decltype(member), const Made>) action(result.*member, field);
    };
    std::visit(call, field.member);
  }
}

template <class Result>
Json record_of(std::span<const Field<Result>> fields, const Result& result) {
  Json record = Json::object();
  for (const Field<Result>& field : fields) record[field.key] = nullptr;  // in this order
  for_each(fields, result, [&](const auto& value, const Field<Result>& field) {
    using Value = std::remove_cvref_t<decltype(value)>;
    if constexpr (std::is_same_v<Value, Eigen::VectorXd>)
      record[field.key] = to_json(value);
    else if constexpr (std::is_same_v<Value, Eigen::MatrixXd>)
      record[field.key] = rows_of(value);
    else
      record[field.key] = value;
  });
  record["method"] = to_text(result.method);
  record["quantiles"] = {{"levels", numerics::k_quantile_levels}, {"values", rows_of(result.quantiles)}};
  return record;
}

/// Those fields that are one number, over the dimension `step` of a group.
template <class Result>
void add_numbers(const std::string& group, std::span<const Field<Result>> fields,
                 std::span<const Result* const> steps, files::NetcdfWriter& out) {
  const std::vector<std::string> dimensions = {std::string(k_step_number)};
  for_each(fields, *steps[0], [&](const auto& first, const Field<Result>& field) {
    if constexpr (std::is_arithmetic_v<std::remove_cvref_t<decltype(first)>>) {
      if (field.key == k_step_number) return;
      std::vector<double> values;
      for (const Result* step : steps)
        for_each(std::span(&field, 1), *step, [&](const auto& value, const auto&) {
          if constexpr (std::is_arithmetic_v<std::remove_cvref_t<decltype(value)>>) values.push_back(value);
        });
      out.add_variable(group, field.key, dimensions, values, {"1", field.meaning});
    }
  });
}

const Json& number_schema() {
  static const Json schema = {{"type", "number"}};
  return schema;
}

Json list_of(const Json& items) {
  return {{"type", "array"}, {"items", items}};
}

Json object_schema(const Json& properties, const Json& required) {
  return {{"type", "object"}, {"properties", properties}, {"required", required}};
}

template <class Result>
Json schema_of(const Field<Result>& field) {
  const auto of_member = [](const auto member) -> Json {
    if constexpr (std::is_same_v<decltype(member), const Made>) {
      return {{"type", member.type}};
    } else {
      using Value = std::remove_cvref_t<decltype(std::declval<Result>().*member)>;
      if constexpr (std::is_same_v<Value, bool>) return {{"type", "boolean"}};
      if constexpr (std::is_same_v<Value, Eigen::VectorXd>) return list_of(number_schema());
      if constexpr (std::is_same_v<Value, Eigen::MatrixXd>) return list_of(list_of(number_schema()));
      if constexpr (std::is_same_v<Value, double>) return number_schema();
      return {{"type", "integer"}};
    }
  };
  Json schema = std::visit(of_member, field.member);
  schema["description"] = field.meaning;
  return schema;
}

template <class Result>
Json schema_of(std::span<const Field<Result>> fields) {
  Json properties = Json::object(), required = Json::array();
  for (const Field<Result>& field : fields) {
    properties[field.key] = schema_of(field);
    required.push_back(field.key);
  }
  return object_schema(properties, required);
}

Json verdict_schema() {
  const Json words = {{"type", "string"}},
             level = {{"type", "string"}, {"enum", {"ok", "caution", "reject"}}};
  const Json reason = object_schema({{"code", words},
                                     {"level", level},
                                     {"value", number_schema()},
                                     {"limit", number_schema()},
                                     {"message", words},
                                     {"cause", words}},
                                    {"code", "level", "value", "limit", "message"});
  return object_schema({{"level", level},
                        {"reasons", list_of(reason)},
                        {"model_shift_std", list_of(number_schema())},
                        {"fit_probability", number_schema()},
                        {"edge_mass", list_of(number_schema())}},
                       {"level", "reasons"});
}

Json decision_schema() {
  const Json words = {{"type", "string"}};
  Json actions = Json::array();
  for (const auto& action : names_of(assimilation::Action{})) actions.push_back(action.word);
  return object_schema({{"action", {{"type", "string"}, {"enum", actions}}},
                        {"time", number_schema()},
                        {"information", number_schema()},
                        {"plan", list_of(number_schema())},
                        {"failure_probability", number_schema()},
                        {"allowed_probability", number_schema()},
                        {"furthest", number_schema()},
                        {"message", words},
                        {"load", number_schema()},
                        {"units", words}},
                       {"action", "time", "information", "plan", "furthest", "message"});
}

}  // namespace

std::span<const Field<UpdateResult>> step_fields() {
  using R = UpdateResult;
  using C = Common<R>;
  static const std::vector<Field<R>> fields = {
      {k_step_number.data(), &R::step, "number of the step"},
      {"time", &R::time, "model time"},
      C::wall_clock,
      C::parameters,
      C::mean,
      C::covariance,
      C::mode,
      C::quantiles,
      C::method,
      C::order,
      C::diagnostic,
      C::tolerance,
      C::ess,
      {"verdict", Made{"object"}, "whether the answer may be used"},
      C::trusted,
      C::evidence,
      {"log_evidence_increment", &R::log_evidence_increment,
       "natural logarithm of the predictive density of the step's datum"},
      {"bias_correction", Made{"string"}, "on or off"},
      {"used", &R::used, "values that were used"},
      {"rejected", &R::rejected, "values that were rejected"},
      {"missing", &R::missing, "values that were not there"},
      C::elapsed,
      {"forecast", Made{"object"}, "forecasts by name"},
      C::physical,
  };
  return fields;
}

std::span<const Field<InferenceResult>> inference_fields() {
  using R = InferenceResult;
  using C = Common<R>;
  static const std::vector<Field<R>> fields = {
      C::method,
      C::parameters,
      C::wall_clock,
      C::mean,
      C::covariance,
      C::mode,
      C::quantiles,
      {"skewness", &R::skewness, "of each parameter"},
      {"kurtosis", &R::kurtosis, "of each parameter, 3 for a Gaussian"},
      {"mean_error", &R::mean_error, "stated, the largest of a mean, in its std"},
      {"deviation_error", &R::deviation_error, "stated, the largest of a std, as a share of it"},
      C::order,
      C::diagnostic,
      C::tolerance,
      C::ess,
      C::trusted,
      {"verdict", Made{"string"}, "trusted or not, and why"},
      {"edge_mass", &R::edge_mass, "mass next to the ends of each prior"},
      C::evidence,
      {"log_evidence_error", &R::log_evidence_error, "standard error of the evidence's logarithm"},
      {"model_evaluations", Made{"integer"}, "values of the model"},
      {"model_calls", Made{"object"}, "calls of the model by kind"},
      C::elapsed,
      {"samples_file", Made{"string"}, "where the draws are"},
      {"distinct_draws", &R::distinct_draws, "how many of the draws differ from all others before them"},
      C::physical,
  };
  return fields;
}

Json fields_record(const UpdateResult& step) {
  return record_of(step_fields(), step);
}

Json fields_record(const InferenceResult& result) {
  return record_of(inference_fields(), result);
}

void read_fields(const JsonObject& line, UpdateResult& step, std::vector<double>& levels) {
  for_each(step_fields(), step, [&](auto& value, const Field<UpdateResult>& field) {
    using Value = std::remove_cvref_t<decltype(value)>;
    if constexpr (std::is_same_v<Value, bool>)
      value = line.boolean(field.key);
    else if constexpr (std::is_same_v<Value, Eigen::VectorXd>)
      value = line.vector(field.key);
    else if constexpr (std::is_same_v<Value, Eigen::MatrixXd>)
      value = line.matrix(field.key);
    else if constexpr (std::is_same_v<Value, double>)
      value = line.number(field.key);
    else
      value = line.count(field.key);
  });
  step.remark = line.text_or("remark");
  step.notice = line.text_or("notice");
  if (const auto method = from_text<posterior::Method>(line.text_or("method"))) step.method = *method;
  const auto d = step.mean.size();
  if (d == 0) line.fail("\"mean\" is empty");
  const auto require_size = [&](const char* key, Index found, const char* what) {
    if (found != d) line.fail(fmt::format("\"{}\" must have {} {}", key, d, what));
  };
  require_size("covariance", step.covariance.rows(), "rows");
  require_size("covariance", step.covariance.cols(), "columns");
  require_size("maximum_a_posteriori", step.maximum_a_posteriori.size(), "numbers");
  const JsonObject quantiles = line.object("quantiles");
  levels = quantiles.numbers("levels");
  step.quantiles = quantiles.matrix("values");
  require_size("quantiles", step.quantiles.rows(), "rows");
  if (step.quantiles.cols() != std::ssize(levels))
    quantiles.fail("each row of \"values\" needs one number per level");
}

Json line_schemas() {
  Json step = schema_of(step_fields());
  step["properties"]["verdict"] = verdict_schema();
  step["properties"]["decision"] = decision_schema();
  return {
      {"step", std::move(step)}, {"inference", schema_of(inference_fields())}, {"verdict", verdict_schema()}};
}

void add_statistics(const std::string& group, std::span<const UpdateResult* const> steps,
                    files::NetcdfWriter& out) {
  add_numbers(group, step_fields(), steps, out);
}

void add_statistics(const std::string& group, const InferenceResult& result, files::NetcdfWriter& out) {
  const InferenceResult* const one = &result;
  add_numbers(group, inference_fields(), std::span(&one, 1), out);
}

}  // namespace knothe::record
