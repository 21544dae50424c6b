#include "knothe/reproduction/study_files.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/base/version.hpp"
#include "knothe/report/figures/svg_text.hpp"
#include "knothe/report/pages/page.hpp"
#include "knothe/report/results/results_writer.hpp"

namespace knothe::reproduction {

using Json = nlohmann::ordered_json;

namespace {

const Row* row_of(const Study& study, const std::string& number, const std::string& begins) {
  for (const FigureRecord& figure : study.figures)
    for (const Row& row : figure.rows)
      if (figure.number == number && row.quantity.starts_with(begins)) return &row;
  return nullptr;
}

std::vector<report::Card> cards(const Study& study) {
  std::vector<report::Card> cards;
  const auto add = [&](const char* name, const char* number, const char* begins, const char* unit) {
    if (const Row* row = row_of(study, number, begins))
      cards.push_back(
          {name, report::readable(row->here_value.value_or(0)) + unit, "paper: " + row->paper + unit, false});
  };
  add("Y₀, truth 1", "8-9", "Y₀: maximum", "");
  add("A_d, truth 1", "8-9", "A_d: maximum", "");
  add("Final crack length", "13", "crack length at the end, mean", " mm");
  add("the same, coarse beam on soft supports", "13", "the same, coarse", " mm");
  add("Slowest step", "13", "slowest step", " s");
  return cards;
}

}  // namespace

std::string heading(const FigureRecord& figure) {
  const bool is_of_the_paper = figure.number.find_first_not_of("0123456789-") == std::string::npos;
  return is_of_the_paper ? fmt::format("Fig. {}. {}", figure.number, figure.title) : figure.title;
}

std::vector<Json> row_records(const FigureRecord& figure) {
  std::vector<Json> records;
  for (const Row& row : figure.rows) {
    Json record = {{"figure", figure.number}, {"quantity", row.quantity}, {"unit", row.unit},
                   {"paper", row.paper},      {"here", row.here},         {"why", row.why}};
    if (row.paper_value) record["paper_value"] = *row.paper_value;
    if (row.here_value) record["here_value"] = *row.here_value;
    records.push_back(std::move(record));
  }
  return records;
}

Json study_record(const Study& study, const StudyOptions& options) {
  Json record = {{"created_by", k_created_by},
                 {"publication", "Rubio, Chamoin, Louf, Comptes Rendus Mecanique 347 (2019) 762-779"},
                 {"quick", options.quick},
                 {"seed", options.seed},
                 {"repetitions", options.repetitions},
                 {"reference", options.reference.what},
                 {"machine", report::machine_record()},
                 {"elapsed_s", study.elapsed_s},
                 {"figures", Json::array()}};
  for (const FigureRecord& figure : study.figures) {
    Json entry = {{"figure", figure.number},
                  {"title", figure.title},
                  {"setting", figure.setting},
                  {"rows", row_records(figure)}};
    for (const Table& table : figure.tables)
      entry["tables"].push_back({{"caption", table.caption}, {"header", table.header}, {"rows", table.rows}});
    for (const auto& [name, values] : figure.data) entry["data"][name] = values;
    record["figures"].push_back(std::move(entry));
  }
  return record;
}

std::string study_page(const Study& study, const StudyOptions& options) {
  report::Page page(
      "The published study, reproduced",
      fmt::format(
          "Rubio, Chamoin, Louf: Real-time Bayesian data assimilation with data selection, correction of "
          "model bias, and on-the-fly uncertainty propagation (2019), section 6, figure by figure. {}, seed "
          "{}, "
          "{} study in {:.0f} s.",
          k_created_by, options.seed, options.quick ? "quick" : "full", study.elapsed_s));
  page.cards(cards(study));
  page.paragraph(
      "Each section computes a figure of the paper again, draws it as the paper does, and says in a table "
      "what the "
      "paper found, what came out here, and why the two differ. What the paper does not say (supports, notch "
      "width, "
      "mesh) was chosen; the last section repeats every conclusion under other choices.");
  for (const FigureRecord& figure : study.figures) {
    page.section(heading(figure));
    page.paragraph(figure.setting);
    for (const Panel& panel : figure.panels) page.figures(panel.figures, panel.caption);
    std::vector<report::TableRow> rows;
    for (const Row& row : figure.rows) {
      const std::string unit = row.unit == "1" ? "" : ", " + row.unit;
      rows.push_back({{row.quantity + unit, row.paper, row.here, row.why}});
    }
    page.table({"quantity", "paper", "here", "why they differ"}, rows);
    for (const Table& table : figure.tables) {
      page.paragraph(table.caption);
      std::vector<report::TableRow> lines;
      for (const auto& line : table.rows) lines.push_back({line});
      page.table(table.header, lines);
    }
  }
  page.section("Provenance");
  std::vector<report::TableRow> rows = {
      {{"Program", k_created_by}},
      {{"Seed", fmt::format("{}", options.seed)}},
      {{"Time of the whole study", report::readable(study.elapsed_s) + " s"}}};
  const Json machine = report::machine_record();
  for (const auto& [name, value] : machine.items())
    rows.push_back({{"Machine: " + name, value.is_string() ? value.get<std::string>() : value.dump()}});
  page.table({}, rows);
  return page.html();
}

void remove_runs(const std::string& models_folder) {
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(models_folder, ignored))
    if (entry.path().extension() == ".parts") std::filesystem::remove_all(entry.path(), ignored);
}

}  // namespace knothe::reproduction
