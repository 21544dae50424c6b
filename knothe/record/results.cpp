#include "knothe/record/results.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/files/json_text.hpp"
#include "knothe/record/fields.hpp"
#include "knothe/record/json_object.hpp"

namespace knothe::record {
namespace {

using nlohmann::json;

DensityCurve density_of(const JsonObject& entry, const char* points, const char* values) {
  DensityCurve d{entry.numbers(points), {}};
  d.values = entry.numbers(values, d.points.size());
  return d;
}

StepForecast forecast_of(const JsonObject& f) {
  StepForecast out;
  out.mean = f.number("mean");
  out.std = f.number("std");
  out.maximum_a_posteriori = f.number("maximum_a_posteriori");
  out.probability_above_threshold = f.number("probability_above_threshold");
  out.units = f.text_or("units");
  out.bridge_residual_rms = f.optional_number("bridge_residual_rms");
  out.levels = f.numbers("levels");
  out.values = f.numbers("values", out.levels.size());
  if (f.has("published")) {
    out.published = f.object("published").numbers("values", out.levels.size());
    const auto& published = f.at("published");  // older files do not say whether they agree
    out.published_agrees = !published.contains("agrees") || published.at("agrees") == true;
  }
  out.is_past = f.has("past") && f.at("past") == true;
  if (f.has("density")) out.density = density_of(f.object("density"), "points", "values");
  return out;
}

void read_watch(const JsonObject& line, Step& s) {
  if (line.has("monitor")) {
    const JsonObject monitor = line.object("monitor");
    s.monitor.smoothed_increment = monitor.number("smoothed_increment");
    s.monitor.cumulative_sum = monitor.number("cumulative_sum");
    s.monitor.threshold = monitor.number("threshold");
    s.monitor.alarm = monitor.at("alarm").is_boolean() && monitor.at("alarm").get<bool>();
    s.monitor.discrepancy = monitor.number_or("discrepancy", 0.0);
  }
  for (const auto& [name, error] : line.named("nuisances"))
    s.lasting_errors.push_back({name, error.number("mean"), error.number("std")});
  for (const auto& [name, m] : line.named("models"))
    s.models[name] = {m.number("probability"), m.number("log_evidence"), m.number("log_bayes_factor")};
}

template <class Word>
Word word(const JsonObject& from, const char* key, Word /*of this kind*/) {
  const auto value = from_text<Word>(from.text_or(key));
  if (!value) from.fail(fmt::format("\"{}\" is \"{}\"", key, from.text_or(key)));
  return *value;
}

assimilation::Decision decision_of(const JsonObject& decision) {
  assimilation::Decision d;
  d.action = word(decision, "action", d.action);
  d.time = decision.number("time");
  d.load = decision.optional_number("load");
  d.load_units = decision.text_or("units");
  d.information = decision.number("information");
  d.plan = decision.numbers("plan");
  d.failure_probability = decision.optional_number("failure_probability");
  d.allowed_probability = decision.optional_number("allowed_probability");
  d.furthest = decision.number("furthest");
  d.message = decision.text_or("message");
  return d;
}

assimilation::Verdict verdict_of(const JsonObject& verdict) {
  using assimilation::VerdictLevel;
  assimilation::Verdict v;
  for (const JsonObject& r : verdict.list("reasons")) {
    assimilation::VerdictReason reason;
    reason.part = word(r, "code", reason.part);
    reason.level = word(r, "level", reason.level);
    reason.value = r.number("value"), reason.limit = r.number("limit");
    reason.message = r.text_or("message");
    if (r.has("cause")) reason.cause = word(r, "cause", assimilation::MisfitCause::unknown);
    v.reasons.push_back(std::move(reason));
  }
  v.level = word(verdict, "level", VerdictLevel::ok);
  v.fit_probability = verdict.number("fit_probability");
  v.model_shift_std = verdict.vector("model_shift_std");
  v.edge_mass = verdict.vector("edge_mass");
  return v;
}

}  // namespace

assimilation::Verdict read_verdict(const nlohmann::json& record, const std::string& where) {
  return verdict_of({record, where});
}

namespace {

Step step_of(const JsonObject& line) {
  Step s;
  read_fields(line, s, s.levels);
  if (line.has("verdict")) s.verdict = verdict_of(line.object("verdict"));
  if (line.has("decision")) s.decision = decision_of(line.object("decision"));
  read_watch(line, s);
  const JsonObject elapsed = line.object("elapsed_us");
  s.update_us = elapsed.number("update");
  s.forecast_us = elapsed.number_or("forecast", 0.0);
  s.total_us = elapsed.number("total");
  for (const auto& [name, marginal] : line.named("marginals"))
    s.marginals[name] = density_of(marginal, "points", "density");
  for (const auto& [name, forecast] : line.named("forecast")) s.forecast[name] = forecast_of(forecast);
  return s;
}

json parse(const std::string& text, const std::string& where) {
  try {
    return files::parse_json(text);
  } catch (const DataError& e) {
    throw DataError(where + ": error: not valid JSON (" + e.what() + ")");
  }
}

std::vector<Step> read_steps(const std::string& path, std::string& computed_at) {
  std::ifstream file(path);
  if (!file)
    throw DataError(path + ": error: cannot be read; `knothe assimilate PROJECT.toml -o RESULTS/` writes it");
  std::vector<Step> steps;
  std::string text;
  for (std::size_t number = 1; std::getline(file, text); ++number) {
    if (text.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string where = fmt::format("{}:{}", path, number);
    const json value = parse(text, where);
    const JsonObject line(value, where);
    if (line.has("done")) continue;
    steps.push_back(step_of(line));
    computed_at = line.text_or("wall_clock");
    if (steps.back().mean.size() != steps.front().mean.size())
      line.fail(fmt::format("{} parameters, but the lines above have {}", steps.back().mean.size(),
                            steps.front().mean.size()));
  }
  if (steps.empty()) throw DataError(path + ":1: error: no assimilated step in it");
  return steps;
}

std::string prior_in_words(const JsonObject& parameter) {
  if (!parameter.has("prior")) return {};
  const json& prior = parameter.at("prior");
  if (prior.is_string()) return prior.get<std::string>();
  if (!prior.is_object()) return prior.dump();
  std::string kind = prior.value("prior", prior.value("kind", std::string("prior"))), numbers;
  for (const auto& [key, value] : prior.items())
    if (value.is_number())
      numbers += (numbers.empty() ? "" : ", ") + key + " = " + fmt::format("{:.4g}", value.get<double>());
  return kind + (numbers.empty() ? "" : " (" + numbers + ")");
}

void read_parameters(const JsonObject& summary, Results& results) {
  if (!summary.has("parameters")) return;
  for (const JsonObject& p : summary.list("parameters"))
    results.parameters.push_back({p.text_or("name"), prior_in_words(p), p.optional_number("lower"),
                                  p.optional_number("upper"), p.optional_number("reference"),
                                  p.text_or("units"), p.optional_number("truth")});
}

void read_residuals(const JsonObject& summary, Residuals& r) {
  if (!summary.has("residuals")) return;
  const JsonObject entry = summary.object("residuals");
  for (const auto& [name, fit] : entry.named("series")) {
    SeriesFit& series = r.series[name];
    series.units = fit.text_or("units");
    series.std = fit.number("std");
    series.step = fit.numbers("step");
    series.measured = fit.numbers("measured", series.step.size());
    series.predicted = fit.numbers("predicted", series.step.size());
  }
  if (!entry.has("step")) return;
  for (const double step : entry.numbers("step")) r.step.push_back(step);
  r.step_rms = entry.numbers("step_rms", r.step.size());
  if (entry.has("noise_rms")) r.noise_rms = entry.numbers("noise_rms", r.step.size());
  if (entry.has("measured")) r.measured = entry.numbers("measured");
  if (entry.has("predicted")) r.predicted = entry.numbers("predicted", r.measured.size());
  r.averaged = entry.count("averaged");
  r.x = entry.numbers("x");
  r.y = entry.numbers("y", r.x.size());
  r.mean = entry.numbers("mean", r.x.size());
  const std::string components = entry.text_or("component");
  if (components.size() != r.x.size()) entry.fail("\"component\" needs one letter per sensor");
  r.component.assign(components.begin(), components.end());
}

void read_summary(const std::string& path, Results& results) {
  std::ifstream file(path);
  if (!file) return;
  const json value = parse({std::istreambuf_iterator<char>(file), {}}, path + ":1");
  const JsonObject summary(value, path);
  results.summary_found = true;
  results.created_by = summary.text_or("created_by");
  results.project = summary.text_or("project");
  results.project_file = summary.text_or("project_file");
  results.model = results.model_path = summary.text_or("model");
  if (const std::string from_here = summary.text_or("model_path"); !from_here.empty())
    results.model_path = std::filesystem::path(path).parent_path() / from_here;
  results.data = summary.text_or("data");
  results.time_units = summary.text_or("time_units");
  results.seed = summary.text_or("seed");
  results.elapsed_s = summary.optional_number("elapsed_s");
  read_parameters(summary, results);
  results.judged = summary.has("verdict");
  if (results.judged) results.verdict = verdict_of(summary.object("verdict"));
  if (summary.has("refinement")) {
    const JsonObject r = summary.object("refinement");
    results.refinement = {r.number("full_order_runs"), r.number("version"), r.number("moved_std")};
  }
  if (summary.has("input_errors"))
    for (const JsonObject& e : summary.list("input_errors"))
      results.input_shifts.push_back({e.text_or("input"), e.number("relative"), e.boolean("limited"),
                                      e.vector("shift"), e.vector("shift_std")});
  for (const auto& [name, marginal] : summary.named("prior_marginals"))
    results.prior_marginals[name] = density_of(marginal, "points", "density");
  for (const auto& [name, f] : summary.named("forecasts"))
    results.forecasts[name] = {f.text_or("quantity"), f.optional_number("horizon"),
                               f.optional_number("threshold"), f.text_or("unit")};
  read_residuals(summary, results.residuals);
  if (summary.has("draws"))
    for (const ParameterSummary& parameter : results.parameters)
      results.draws.push_back(summary.object("draws").numbers(parameter.name.c_str()));
  if (summary.has("load_displacement")) {
    const JsonObject curve = summary.object("load_displacement");
    results.displacement = curve.numbers("displacement");
    if (curve.has("time")) results.curve_time = curve.numbers("time", results.displacement.size());
    results.force = curve.numbers("force", results.displacement.size());
  }
  if (summary.has("machine") && summary.at("machine").is_object())
    for (const auto& [name, entry] : summary.at("machine").items())
      results.machine.emplace_back(name, entry.is_string() ? entry.get<std::string>() : entry.dump());
}

}  // namespace

std::vector<double> Results::step_numbers() const {
  std::vector<double> numbers;
  for (const auto& s : steps) numbers.push_back(s.step);
  return numbers;
}

bool Results::has_maps() const {
  return std::any_of(steps.begin(), steps.end(), [](const Step& s) { return s.map_order > 0; });
}

std::vector<std::size_t> Results::untrusted() const {
  std::vector<std::size_t> numbers;
  for (const auto& s : steps)
    if (!s.trusted) numbers.push_back(s.step);
  return numbers;
}

std::vector<std::string> Results::forecast_names() const {
  std::vector<std::string> names;
  for (const auto& [name, forecast] : steps.back().forecast) names.push_back(name);
  return names;
}

Results read_results(const std::string& folder) {
  if (!std::filesystem::is_directory(folder))
    throw DataError(
        folder + ": error: no such results folder; `knothe assimilate PROJECT.toml -o RESULTS/` makes one");
  const std::filesystem::path base(folder);
  Results results;
  results.folder = folder;
  results.steps = read_steps((base / "steps.jsonl").string(), results.computed_at);
  results.monitored = std::all_of(results.steps.begin(), results.steps.end(),
                                  [](const Step& s) { return s.monitor.threshold > 0; });
  read_summary((base / "summary.json").string(), results);
  const std::size_t d = results.steps.front().mean.size();
  if (!results.parameters.empty() && results.parameters.size() != d)
    throw DataError(fmt::format("{}: error: {} parameters, but steps.jsonl has {}",
                                (base / "summary.json").string(), results.parameters.size(), d));
  for (std::size_t i = results.parameters.size(); i < d; ++i)
    results.parameters.push_back({fmt::format("parameter {}", i), {}, {}, {}, {}, {}, {}});
  return results;
}

}  // namespace knothe::record
