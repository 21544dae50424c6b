#include "knothe/report/data/report_record.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "knothe/base/index.hpp"
#include "knothe/files/json_text.hpp"
#include "knothe/report/data/specimen.hpp"

namespace knothe::report {
namespace {

using Json = nlohmann::ordered_json;

constexpr Index k_max_densities = 40;  ///< steps with their densities
constexpr int k_digits = 7;            ///< of the record
constexpr int k_field_digits = 4;      ///< of fields and curves, which are only looked at

/// What figures are drawn from, of a line.
constexpr auto k_members = std::to_array<const char*>({"step",
                                                       "time",
                                                       "mean",
                                                       "covariance",
                                                       "maximum_a_posteriori",
                                                       "quantiles",
                                                       "ess",
                                                       "map_order",
                                                       "trusted",
                                                       "variance_diagnostic",
                                                       "log_evidence",
                                                       "log_evidence_increment",
                                                       "used",
                                                       "rejected",
                                                       "missing",
                                                       "elapsed_us",
                                                       "bias_correction",
                                                       "forecast",
                                                       "monitor",
                                                       "models",
                                                       "marginals"});

/// A line without what no figure shows; densities only where `with_densities`.
Json line_record(const nlohmann::json& line, bool with_densities) {
  Json out;
  for (const char* member : k_members)
    if (line.contains(member) && (with_densities || std::string(member) != "marginals"))
      out[member] = line.at(member);
  if (line.contains("verdict"))
    for (const char* member : {"level", "model_shift_std"})
      if (line.at("verdict").contains(member)) out["verdict"][member] = line.at("verdict").at(member);
  if (line.contains("decision")) {
    out["decision"] = line.at("decision");
    out["decision"].erase("plan");
  }
  if (!out.contains("forecast")) out["forecast"] = Json::object();
  for (auto& [name, forecast] : out["forecast"].items()) {
    forecast.erase("direct");
    if (!with_densities) forecast.erase("density");
  }
  return out;
}

/// Of the folder's lines; `read_results` has found them sound.
Json lines_record(const record::Results& results) {
  std::ifstream file(std::filesystem::path(results.folder) / "steps.jsonl");
  Json lines = Json::array();
  const Index count = std::ssize(results.steps), stride = 1 + (count - 1) / k_max_densities;
  for (std::string text; std::getline(file, text);) {
    if (text.find_first_not_of(" \t\r") == std::string::npos) continue;
    const nlohmann::json line = files::parse_json(text);
    if (line.contains("done")) continue;
    lines.push_back(line_record(line, (count - 1 - std::ssize(lines)) % stride == 0));
  }
  return lines;
}

/// What the pages draws of summary.json; without it, the names that the results were given.
Json summary_record(const record::Results& results) {
  Json summary = Json::object();
  const std::filesystem::path path = std::filesystem::path(results.folder) / "summary.json";
  if (results.summary_found) {
    const nlohmann::json content = files::read_json(path.string());
    for (const char* member : {"prior_marginals", "draws", "forecasts"})
      if (content.contains(member)) summary[member] = content.at(member);
    if (content.contains("residuals"))
      for (const char* member : {"step", "step_rms", "noise_rms"})
        if (content.at("residuals").contains(member))
          summary["residuals"][member] = content.at("residuals").at(member);
  }
  summary["parameters"] = Json::array();
  for (const record::ParameterSummary& p : results.parameters) {
    Json entry = {{"name", p.name}};
    if (p.lower) entry["lower"] = *p.lower;
    if (p.upper) entry["upper"] = *p.upper;
    if (p.reference) entry["reference"] = *p.reference;
    if (!p.units.empty()) entry["units"] = p.units;
    if (p.truth) entry["truth"] = *p.truth;
    summary["parameters"].push_back(std::move(entry));
  }
  return summary;
}

/// Digits that numbers of a list need beyond those of their range: points of a narrow density differ in their
/// last digits alone.
int common_digits(const Json& list) {
  double low = INFINITY, high = -INFINITY;
  for (const Json& value : list) {
    if (!value.is_number()) return 0;
    low = std::min(low, value.get<double>());
    high = std::max(high, value.get<double>());
  }
  const double largest = std::max(std::abs(low), std::abs(high));
  return high > low && high - low < largest ? std::ceil(std::log10(largest / (high - low))) : 0;
}

}  // namespace

void shorten_numbers(Json& value, int digits) {
  if (value.is_number_float()) {
    value = std::strtod(fmt::format("{:.{}g}", value.get<double>(), std::min(digits, 17)).c_str(), nullptr);
  } else if (value.is_structured()) {
    const int more = value.is_array() ? common_digits(value) : 0;
    for (auto& member : value) shorten_numbers(member, digits + more);
  }
}

Json assimilation_record(const record::Results& results, const model::SeparatedModel* model) {
  Json record = {
      {"kind", "assimilation"}, {"lines", lines_record(results)}, {"summary", summary_record(results)}};
  record.update(predictions_record(results));
  shorten_numbers(record, k_digits);
  Json drawn = Json::object();
  if (const record::Residuals& r = results.residuals; !r.x.empty())
    drawn["sensors"] = {{"x", r.x},
                        {"y", r.y},
                        {"mean", r.mean},
                        {"component", std::string(r.component.begin(), r.component.end())},
                        {"averaged", r.averaged}};
  if (Json load = load_record(results, model); !load.is_null()) drawn["load"] = std::move(load);
  if (!results.time_units.empty()) record["time_units"] = results.time_units;
  if (model != nullptr) {
    const std::vector<double> p = drawing_point(results, *model);
    if (can_be_drawn(*model)) drawn["specimen"] = specimen_record(*model, p);
    drawn["functions"] = functions_record(*model, p);
  }
  shorten_numbers(drawn, k_field_digits);
  record.update(drawn);
  return record;
}

}  // namespace knothe::report
