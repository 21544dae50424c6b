#include "knothe/report/pages/comparison_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_text.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/data/report_record.hpp"
#include "knothe/report/pages/inference_report.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {
namespace {

using Json = nlohmann::json;
using Numbers = std::vector<double>;
namespace fs = std::filesystem;

/// What the figures are drawn from.
nlohmann::ordered_json record_of(const Json& first, const Json& second) {
  nlohmann::ordered_json contents = nlohmann::ordered_json::array();
  for (const Json* one : {&first, &second}) {
    contents.push_back({{"figures", {{"posterior", one->at("figures").at("posterior")}}}});
    for (const char* member : {"method", "parameters", "covariance", "physical"})
      if (one->contains(member)) contents.back()[member] = one->at(member);
  }
  nlohmann::ordered_json record = {{"kind", "comparison"}, {"contents", std::move(contents)}};
  shorten_numbers(record, 6);
  return record;
}

std::string page_of(const Json& comparison, const Json& first, const Json& second) {
  const Json& c = comparison.at("comparison");
  const std::string a = c.at("methods").at(0), b = c.at("methods").at(1);
  const auto parameters = first.at("parameters").get<std::vector<std::string>>();
  double largest = 0;
  for (const double x : c.at("mean_difference").get<Numbers>()) largest = std::max(largest, std::abs(x));
  const bool agree = c.at("agreement") == "agree";
  Page page(
      "Two methods compared",
      fmt::format("{} and {} {}: their means differ by at most {} standard deviations of the posterior.", a,
                  b, agree ? "agree" : "contradict each other", record::readable(largest, 2)));
  std::vector<std::string> sentences;
  Usability worth = agree ? Usability::usable : Usability::not_usable;
  for (const Json* one : {&first, &second}) {
    InferenceJudgement judged = judgement(*one);
    worth = std::max(worth, judged.usability);
    for (const std::string& sentence : judged.sentences)
      sentences.push_back(one->at("method").get<std::string>() + ": " + sentence);
    sentences.back() += fmt::format(" {} model evaluations.", one->at("model_evaluations").get<long>());
  }
  sentences.push_back(
      fmt::format("Log-evidence, {} minus {}: {}.", b, a,
                  record::with_uncertainty(c.at("log_evidence_difference"),
                                           std::max(1e-6, c.at("log_evidence_error").get<double>()))));
  page.result(worth, sentences);
  page.section(fmt::format("{} minus {}, in units of the posterior's standard deviation", b, a));
  std::vector<std::string> head = {"parameter", "mean", "ratio of deviations"};
  for (const double level : c.at("quantile_difference").at("levels").get<Numbers>())
    head.push_back(fmt::format("{:g} %", 100 * level));
  std::vector<TableRow> rows;
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    std::vector<std::string> cells = {parameters[k], record::readable(c.at("mean_difference").at(k), 2),
                                      record::readable(c.at("std_ratio").at(k), 4)};
    for (const double q : c.at("quantile_difference").at("values").at(k).get<Numbers>())
      cells.push_back(record::readable(q, 2));
    rows.push_back({std::move(cells)});
  }
  page.table(head, rows);
  page.section("Marginal posteriors");
  std::vector<FigurePlace> figures;
  for (std::size_t k = 0; k < std::min<std::size_t>(parameters.size(), 6); ++k)
    figures.push_back({fmt::format("marginal:{}", k), "Marginal of " + parameters[k]});
  page.figures(figures, "Where the curves coincide, two independent methods agree.");
  page.section("Provenance");
  page.table({}, {{{"Program", first.at("created_by").get<std::string>()}},
                  {{"Model", first.at("model").get<std::string>()}}});
  page.details("The project file", first.at("project").get<std::string>());
  return page.html(record_of(first, second));
}

}  // namespace

bool holds_comparison(const std::string& results_folder) {
  const fs::path folder(results_folder);
  std::error_code none;
  return fs::exists(folder / "comparison.json", none) && !fs::exists(folder / "inference.json", none) &&
         !fs::exists(folder / "steps.jsonl", none);
}

void write_comparison_report(const std::string& results_folder, const std::string& output) {
  const fs::path folder(results_folder), path = folder / "comparison.json";
  const Json comparison = files::read_json(path);
  std::string page;
  try {
    const Json& methods = comparison.at("comparison").at("methods");
    page = page_of(comparison, files::read_json(folder / methods.at(0).get<std::string>() / "inference.json"),
                   files::read_json(folder / methods.at(1).get<std::string>() / "inference.json"));
  } catch (const Json::exception& error) {
    throw DataError(
        fmt::format("{}: not what `knothe infer --compare` writes: {}", path.string(), error.what()));
  }
  files::write_text_atomically(output, page);
}

}  // namespace knothe::report
