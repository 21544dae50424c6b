#include "knothe/report/pages/study_report.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_text.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {
namespace {

using Json = nlohmann::json;
using Words = std::vector<std::string>;
namespace fs = std::filesystem;

std::string file_of(const std::string& folder) {
  return fs::path(folder) / "reproduce.json";
}

Table table_of(const std::string& caption, const Words& header, const Json& rows) {
  Table table{caption, header, {}};
  for (const Json& row : rows) table.rows.push_back({row.get<Words>()});
  return table;
}

/// Paper, here, and why the two differ.
Table comparison_of(const Json& rows) {
  Table table{{}, {"quantity", "paper", "here", "why they differ"}, {}};
  for (const Json& row : rows) {
    const std::string unit = row.at("unit");
    table.rows.push_back({{row.at("quantity").get<std::string>() + (unit == "1" ? "" : ", " + unit),
                           row.at("paper"), row.at("here"), row.at("why")}});
  }
  return table;
}

/// The section of a figure of the paper; its drawings are put behind those that `drawings` has.
void add_figure(Page& page, const Json& figure, nlohmann::ordered_json& drawings) {
  page.section(figure.at("heading")).paragraph(figure.at("setting"));
  for (const Json& panel : figure.at("panels")) {
    std::vector<FigurePlace> places;
    for (const Json& drawing : panel.at("drawings")) {
      places.push_back({fmt::format("drawing:{}", drawings.size()), drawing.at("title")});
      drawings.emplace_back(drawing);
    }
    page.figures(places, panel.at("caption"));
  }
  page.tables({comparison_of(figure.at("rows"))});
  if (figure.contains("tables"))
    for (const Json& table : figure.at("tables"))
      page.tables({table_of(table.at("caption"), table.at("header"), table.at("rows"))});
}

std::string page_of(const Json& study) {
  const std::string program = study.at("created_by");
  const long seed = study.at("seed");
  Page page(
      "The published study, reproduced",
      fmt::format("{}, section 6, figure by figure. {}, seed {}, {} study in {:.0f} s.",
                  study.at("publication").get<std::string>(), program, seed,
                  study.at("quick").get<bool>() ? "quick" : "full", study.at("elapsed_s").get<double>()));
  page.tables({table_of("In short", {"quantity", "paper", "here"}, study.at("first"))});
  page.paragraph(
      "Each section computes a figure of the paper, draws it, and compares it with the published values. The "
      "paper does not give supports, notch width and mesh; the last section repeats the conclusions under "
      "other choices.");
  nlohmann::ordered_json record = {
      {"kind", "study"}, {"faces", study.at("faces")}, {"drawings", nlohmann::ordered_json::array()}};
  for (const Json& figure : study.at("figures")) add_figure(page, figure, record["drawings"]);
  page.section("Provenance");
  Table table{{}, {}, {{{"Program", program}}, {{"Seed", std::to_string(seed)}}}};
  for (const auto& [name, value] : study.at("machine").items())
    table.rows.push_back({{"Machine: " + name, value.is_string() ? value.get<std::string>() : value.dump()}});
  page.tables({table});
  return page.html(record);
}

}  // namespace

bool holds_study(const std::string& folder) {
  std::error_code none;
  return fs::exists(file_of(folder), none);
}

void write_study_report(const std::string& folder, const std::string& output) {
  const Json study = files::read_json(file_of(folder));
  std::string page;
  try {
    page = page_of(study);
  } catch (const Json::exception& error) {
    throw DataError(fmt::format("{}: not what `knothe reproduce` writes: {}", file_of(folder), error.what()));
  }
  files::write_text_atomically(output, page);
}

}  // namespace knothe::report
