#include "knothe/report/pages/inference_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/assimilation/verdict/assessor.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_text.hpp"
#include "knothe/record/forecast_text.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/data/report_record.hpp"
#include "knothe/report/data/words.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {
namespace {

using Json = nlohmann::json;
using Numbers = std::vector<double>;

/// What the page needs of the file, in one place; nlohmann's exceptions become DataErrors around it.
struct Content {
  std::vector<std::string> parameters;
  Numbers mean, std, most_probable, skewness, kurtosis;
  Numbers scale;                   ///< from a parameter to its number in `unit`
  std::vector<std::string> unit;   ///< as it stands behind a number; "" where the model states none
  std::vector<Numbers> quantiles;  ///< parameter × level
  std::string method;
  const Json* figures = nullptr;

  explicit Content(const Json& c) {
    c.at("parameters").get_to(parameters);
    c.at("mean").get_to(mean);
    c.at("maximum_a_posteriori").get_to(most_probable);
    c.at("skewness").get_to(skewness);
    c.at("kurtosis").get_to(kurtosis);
    c.at("quantiles").at("values").get_to(quantiles);
    c.at("method").get_to(method);
    figures = &c.at("figures");
    for (std::size_t k = 0; k < parameters.size(); ++k) {
      std.push_back(std::sqrt(std::max(0.0, c.at("covariance").at(k).at(k).get<double>())));
      add_unit(c.value("physical", Json::object()).value(parameters[k], Json::object()));
    }
  }
  [[nodiscard]] bool has_map() const { return figures->contains("map"); }
  [[nodiscard]] std::size_t shown(std::size_t most) const { return std::min(most, parameters.size()); }

 private:
  /// Of the next parameter: what the model says it is in physical units.
  void add_unit(const Json& physical) {
    const double deviation = std.back();
    const bool is_known = physical.contains("units") && deviation > 0;
    const auto [factor, symbol] = record::readable_unit(
        is_known ? std::abs(physical.at("mean").get<double>()) : 0,
        is_known ? pretty_units(physical.at("units").get<std::string>()) : std::string());
    scale.push_back(is_known ? factor * physical.at("std").get<double>() / deviation : 1);
    unit.push_back(symbol);
  }
};

void add_parameters(Page& page, const Content& c, Usability worth) {
  const bool is_rejected = worth == Usability::not_usable;
  const auto number = [&](double value, std::size_t k) {
    return record::readable(c.scale[k] * value, is_rejected ? 2 : 4);
  };
  Table table{"Parameters",
              {"parameter", "estimate", "most probable", "95 % between", "skewness", "kurtosis"},
              {},
              worth};
  for (std::size_t k = 0; k < c.parameters.size(); ++k)
    table.rows.push_back(
        {{c.parameters[k],
          (is_rejected ? number(c.mean[k], k)
                       : record::with_uncertainty(c.scale[k] * c.mean[k], c.scale[k] * c.std[k])) +
              c.unit[k],
          number(c.most_probable[k], k) + c.unit[k],
          fmt::format("{} … {}{}", number(c.quantiles[k].front(), k), number(c.quantiles[k].back(), k),
                      c.unit[k]),
          record::readable(c.skewness[k], 2), record::readable(c.kurtosis[k], 3)}});
  page.tables({table});
  page.note("±: one standard deviation of the posterior. Skewness and kurtosis are 0 and 3 for a Gaussian.");
}

FigurePlace marginal(const Content& c, std::size_t k) {
  return {fmt::format("marginal:{}", k), "Prior and posterior of " + c.parameters[k]};
}

/// Of the first screen: what was observed, and what was inferred; then the numbers.
void add_first_screen(Page& page, const Content& c, Usability worth) {
  std::vector<FigurePlace> figures;
  if (c.figures->contains("observations"))
    figures.push_back({"observations", "Observations, and their prediction at the most probable parameters"});
  if (c.parameters.size() > 1)
    figures.push_back({"pairs", "Draws of the posterior, pair by pair"});
  else
    figures.push_back(marginal(c, 0));
  page.figures(figures);
  add_parameters(page, c, worth);
  if (c.parameters.size() > 5) page.note("Only the first 5 parameters are drawn pair by pair.");
  if (c.has_map() && c.parameters.size() > 1)
    page.note(
        "Blue draws: the posterior, importance-corrected. Orange: what the map alone would say. Where both "
        "differ, the correction was needed.");
}

void add_marginals(Page& page, const Content& c) {
  if (c.parameters.size() < 2) return;
  page.section("Prior and posterior of each parameter");
  std::vector<FigurePlace> figures;
  for (std::size_t k = 0; k < c.shown(6); ++k) figures.push_back(marginal(c, k));
  page.figures(figures);
}

void add_map(Page& page, const Content& c) {
  page.section("Pull-back of the posterior beside a standard normal");
  std::vector<FigurePlace> figures;
  for (std::size_t k = 0; k < c.shown(4); ++k)
    figures.push_back({fmt::format("pull_back:{}", k), fmt::format("Pulled-back marginal of x{}", k + 1)});
  page.figures(figures,
               "The posterior seen through the map. If the map is exact this is a standard normal; a "
               "shoulder or a bend is what the map has missed.");
  if (c.figures->at("diagnostic_by_order").empty()) return;
  page.section("Objective and diagnostic over order");
  if (const auto method = c.figures->value("map_method", std::string()); !method.empty())
    page.paragraph("The map: " + method + ".");
  figures = {{"orders:diagnostic", "Variance diagnostic by order"}};
  if (c.figures->contains("objective_by_order"))
    figures.push_back({"orders:objective", "Objective by order"});
  page.figures(figures,
               "How far the map's density is from the posterior, order by order. At high "
               "orders the training rule underestimates it; the verified figure counts. The objective falls "
               "towards minus the log-evidence.");
}

/// What the figures are drawn from.
nlohmann::ordered_json record_of(const Json& content) {
  nlohmann::ordered_json record = {{"kind", "inference"}, {"content", nlohmann::ordered_json::object()}};
  for (const char* member :
       {"method", "parameters", "physical", "mean", "covariance", "maximum_a_posteriori", "quantiles",
        "log_evidence", "map_order", "variance_diagnostic", "tolerance", "figures"})
    if (content.contains(member)) record["content"][member] = content.at(member);
  shorten_numbers(record, 6);
  return record;
}

void add_phases(Page& page, const Json& content) {
  page.section("Time per phase");
  std::vector<TableRow> rows;
  double total = 0, model = 0;
  for (const Json& phase : content.at("phases")) {
    const double seconds = phase.at("seconds"), model_seconds = phase.at("model_seconds");
    total += seconds, model += model_seconds;
    rows.push_back({{phase.at("name").get<std::string>(), record::readable(seconds, 3) + " s",
                     record::readable(model_seconds, 3) + " s"}});
  }
  rows.push_back({{"together", record::readable(total, 3) + " s", record::readable(model, 3) + " s"}});
  page.table({"phase", "time", "of which the model took"}, rows);
  const Json& calls = content.at("model_calls");
  page.paragraph(fmt::format(
      "The model was evaluated {} times; {} gradients, {} Jacobian and {} Hessian products were asked for.",
      calls.at("evaluate").get<long>(), calls.at("gradient").get<long>(),
      calls.at("apply_jacobian").get<long>(), calls.at("apply_hessian").get<long>()));
}

void add_provenance(Page& page, const Json& content, const Content& c) {
  page.section("Provenance");
  std::vector<TableRow> rows = {{{"Program", content.at("created_by").get<std::string>()}},
                                {{"Model", content.at("model").get<std::string>()}},
                                {{"Method", c.method}},
                                {{"Seed", std::to_string(content.at("seed").get<unsigned long>())}}};
  for (std::size_t k = 0; k < c.parameters.size(); ++k)
    rows.push_back({{"Prior of " + c.parameters[k], content.at("priors").at(k).get<std::string>()}});
  page.table({}, rows);
  page.details("The project file", content.at("project").get<std::string>());
}

}  // namespace

bool holds_inference(const std::string& results_folder) {
  const std::filesystem::path folder(results_folder);
  std::error_code none;
  if (!std::filesystem::exists(folder / "inference.json", none)) return false;
  if (!std::filesystem::exists(folder / "steps.jsonl", none)) return true;
  return std::filesystem::last_write_time(folder / "inference.json", none) >
         std::filesystem::last_write_time(folder / "steps.jsonl", none);
}

InferenceJudgement judgement(const Json& content) {
  const assimilation::VerdictOptions limits;
  const double fit = content.value("fit_probability", 1.0);
  auto sentences = content.value("doubts", std::vector<std::string>());
  for (std::string& sentence : sentences) {
    const unsigned char first = sentence[0];
    sentence[0] = std::toupper(first);
  }
  const bool is_trusted = content.at("trusted"), has_doubt = !sentences.empty();
  std::string computation = content.value("computation", content.at("verdict").get<std::string>());
  const unsigned char first = computation[0];
  computation[0] = std::tolower(first);
  sentences.push_back("Computation " + computation);
  if (!is_trusted || fit < limits.fit_reject) return {Usability::not_usable, std::move(sentences)};
  const bool is_clean = !has_doubt && fit >= limits.fit_caution && content.value("tolerance_reached", true);
  return {is_clean ? Usability::usable : Usability::with_caveats, std::move(sentences)};
}

std::string inference_report(const Json& content, const std::string& where) {
  try {
    const Content c(content);
    Page page("What the observations say", "Method: " + c.method + ".");
    const double ess = content.at("ess");
    InferenceJudgement judged = judgement(content);
    judged.sentences.push_back(fmt::format(
        "{}effective sample size {} %; log-evidence {}; {} model evaluations.",
        c.has_map()
            ? fmt::format("Map diagnostic {}; ", record::readable(content.at("variance_diagnostic"), 2))
            : std::string(),
        record::readable(100 * ess, 3),
        record::with_uncertainty(content.at("log_evidence"),
                                 std::max(1e-6, content.at("log_evidence_error").get<double>())),
        content.at("model_evaluations").get<long>()));
    page.result(judged.usability, judged.sentences);
    add_first_screen(page, c, judged.usability);
    add_marginals(page, c);
    if (c.has_map()) add_map(page, c);
    add_phases(page, content);
    add_provenance(page, content, c);
    return page.html(record_of(content));
  } catch (const Json::exception& error) {
    throw DataError(fmt::format("{}: not what `knothe infer` writes: {}", where, error.what()));
  }
}

void write_inference_report(const std::string& results_folder, const std::string& output) {
  const std::string path = (std::filesystem::path(results_folder) / "inference.json").string();
  files::write_text_atomically(output, inference_report(files::read_json(path), path));
}

}  // namespace knothe::report
