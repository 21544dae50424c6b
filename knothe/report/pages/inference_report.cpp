#include "knothe/report/pages/inference_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_text.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {
namespace {

using Json = nlohmann::json;
using Numbers = std::vector<double>;

/// What the page needs of the file, in one place; nlohmann's exceptions become DataErrors around it.
struct Content {
  std::vector<std::string> parameters;
  Numbers mean, std, most_probable, skewness, kurtosis;
  std::vector<Numbers> quantiles;  ///< parameter × level
  std::string method, verdict;
  bool trusted = false;
  const Json* figures = nullptr;

  explicit Content(const Json& c) {
    c.at("parameters").get_to(parameters);
    c.at("mean").get_to(mean);
    c.at("maximum_a_posteriori").get_to(most_probable);
    c.at("skewness").get_to(skewness);
    c.at("kurtosis").get_to(kurtosis);
    c.at("quantiles").at("values").get_to(quantiles);
    c.at("method").get_to(method);
    c.at("verdict").get_to(verdict);
    c.at("trusted").get_to(trusted);
    figures = &c.at("figures");
    for (std::size_t k = 0; k < parameters.size(); ++k)
      std.push_back(std::sqrt(std::max(0.0, c.at("covariance").at(k).at(k).get<double>())));
  }
  [[nodiscard]] bool has_map() const { return figures->contains("map"); }
  [[nodiscard]] Numbers density(const char* which, std::size_t k, const char* member) const {
    return figures->at(which).at(k).at(member).get<Numbers>();
  }
  [[nodiscard]] Numbers draws(const char* which, std::size_t k) const {
    return figures->at(which).at(k).get<Numbers>();
  }
};

Plot marginal_plot(const Content& c, std::size_t k) {
  Plot plot("", {c.parameters[k]}, {"density", 0.0});
  const Numbers x = c.density("posterior", k, "points"), y = c.density("posterior", k, "density");
  plot.band(x, Numbers(x.size(), 0.0), y, Paint::series(0), "posterior");
  plot.line(x, y, Paint::series(0));
  if (c.has_map())
    plot.line(c.density("map", k, "points"), c.density("map", k, "density"), Paint::series(1),
              "map, not corrected", {1.6, "5 4", 1.0});
  return plot;
}

Plot prior_plot(const Content& c, std::size_t k) {
  Plot plot("", {c.parameters[k]}, {"density", 0.0});
  plot.line(c.density("prior", k, "points"), c.density("prior", k, "density"), Paint::faint(), "prior",
            {1.6, "6 4", 1.0});
  plot.line(c.density("posterior", k, "points"), c.density("posterior", k, "density"), Paint::series(0),
            "posterior");
  plot.vertical(c.most_probable[k], Paint::ink(), "most probable");
  return plot;
}

Plot pair_plot(const Content& c, std::size_t row, std::size_t column) {
  Plot plot("", {c.parameters[column]}, {c.parameters[row]});
  plot.scatter(c.draws("draws", column), c.draws("draws", row), Paint::series(0), "posterior, weighted", 1.8);
  if (c.has_map())
    plot.scatter(c.draws("map_draws", column), c.draws("map_draws", row), Paint::series(1),
                 "map, not corrected", 1.2);
  return plot;
}

/// Lower triangle: pairs; diagonal: marginals. Row by row, without the empty upper half.
void add_pairs(Page& page, const Content& c) {
  page.section("Pairwise marginals");
  const std::size_t d = std::min<std::size_t>(c.parameters.size(), 5);
  std::vector<Figure> figures;
  for (std::size_t i = 0; i < d; ++i)
    for (std::size_t j = 0; j <= i; ++j)
      figures.push_back(i == j
                            ? figure_of(marginal_plot(c, i), "Marginal of " + c.parameters[i])
                            : figure_of(pair_plot(c, i, j), c.parameters[i] + " against " + c.parameters[j]));
  page.figures(figures, c.has_map()
                            ? "Blue: the posterior, importance-corrected. Vermilion: what the map alone "
                              "would say. Where both differ, the correction was needed."
                            : "Draws of the posterior, pair by pair, and the density of each parameter.");
  if (c.parameters.size() > d) page.note(fmt::format("Only the first {} parameters are drawn.", d));
}

void add_parameters(Page& page, const Content& c) {
  page.section("The parameters");
  std::vector<TableRow> rows;
  for (std::size_t k = 0; k < c.parameters.size(); ++k)
    rows.push_back({{c.parameters[k], record::readable(c.mean[k], 5), record::readable(c.std[k], 3),
                     record::readable(c.most_probable[k], 5),
                     fmt::format("{} … {}", record::readable(c.quantiles[k].front(), 4),
                                 record::readable(c.quantiles[k].back(), 4)),
                     record::readable(c.skewness[k], 2), record::readable(c.kurtosis[k], 3)}});
  page.table(
      {"parameter", "mean", "standard deviation", "most probable", "95 % between", "skewness", "kurtosis"},
      rows);
  if (!c.figures->contains("prior")) return;
  std::vector<Figure> figures;
  for (std::size_t k = 0; k < std::min<std::size_t>(c.parameters.size(), 6); ++k)
    figures.push_back(figure_of(prior_plot(c, k), "Prior and posterior of " + c.parameters[k], 260.0));
  page.figures(figures, "Prior and posterior. Skewness and kurtosis are 0 and 3 for a Gaussian.");
}

void add_pull_back(Page& page, const Content& c) {
  page.section("Pull-back of the posterior beside a standard normal");
  std::vector<Figure> figures;
  const std::size_t d = std::min<std::size_t>(c.parameters.size(), 4);
  for (std::size_t k = 0; k < d; ++k) {
    const std::string name = fmt::format("x{}", k + 1);
    Plot plot("", {name}, {"density", 0.0});
    plot.line(c.density("pull_back", k, "points"), c.density("pull_back", k, "density"), Paint::series(0),
              "posterior, pulled back");
    plot.line(c.density("reference", k, "points"), c.density("reference", k, "density"), Paint::ink(),
              "standard normal", {1.4, "5 4", 1.0});
    figures.push_back(figure_of(std::move(plot), "Pulled-back marginal of " + name, 260.0));
  }
  if (c.parameters.size() > 1) {
    Plot plot("", {"x1"}, {"x2"});
    plot.scatter(c.draws("pull_back_draws", 0), c.draws("pull_back_draws", 1), Paint::series(0),
                 "posterior, pulled back", 1.6);
    Numbers x, y;
    for (int i = 0; i <= 120; ++i) {
      x.push_back(std::cos(i * 2 * 3.141592653589793 / 120));
      y.push_back(std::sin(i * 2 * 3.141592653589793 / 120));
    }
    for (const double radius : {1.1774, 2.4477}) {  // hold 50 % and 95 % of a plane standard normal
      Numbers rx, ry;
      for (std::size_t i = 0; i < x.size(); ++i) rx.push_back(radius * x[i]), ry.push_back(radius * y[i]);
      plot.line(rx, ry, Paint::ink(), "50 %, 95 % of a standard normal", {1.4, "5 4", 1.0});
    }
    figures.push_back(figure_of(std::move(plot), "Pulled-back pair x1, x2", 260.0));
  }
  page.figures(figures,
               "The posterior seen through the map. If the map is exact this is a standard normal; a "
               "shoulder or a bend is what the map has missed.");
}

void add_orders(Page& page, const Json& content, const Content& c) {
  const auto diagnostic = c.figures->at("diagnostic_by_order").get<Numbers>();
  if (diagnostic.empty()) return;
  page.section("Objective and diagnostic over order");
  Numbers order, shown;
  for (std::size_t i = 0; i < diagnostic.size(); ++i) {
    order.push_back(i + 1);
    shown.push_back(std::max(diagnostic[i], 1e-16));
  }
  std::vector<Figure> figures;
  Plot plot("", {"order of the map", 0.5, order.back() + 0.5}, {"variance diagnostic", {}, {}, true});
  plot.line(order, shown, Paint::series(0), "on the training rule");
  plot.scatter(order, shown, Paint::series(0));
  plot.scatter(Numbers{content.at("map_order").get<double>()},
               Numbers{std::max(content.at("variance_diagnostic").get<double>(), 1e-16)}, Paint::series(1),
               "verified on points not used to train the map", 5.0);
  plot.horizontal(content.at("tolerance").get<double>(), Paint::truth(), "tolerance");
  figures.push_back(figure_of(std::move(plot), "Variance diagnostic by order"));
  if (c.figures->contains("objective_by_order")) {
    auto objective = c.figures->at("objective_by_order").get<Numbers>();
    Plot objectives("", {"order of the map", 0.5, order.back() + 0.5}, {"Kullback–Leibler objective"});
    objective.resize(std::min(objective.size(), order.size()));
    const Numbers at(order.begin(), order.begin() + std::ssize(objective));
    objectives.line(at, objective, Paint::series(2), "objective (training)");
    objectives.scatter(at, objective, Paint::series(2));
    objectives.horizontal(-content.at("log_evidence").get<double>(), Paint::truth(), "−log evidence");
    figures.push_back(figure_of(std::move(objectives), "Objective by order"));
  }
  if (const auto method = c.figures->value("map_method", std::string()); !method.empty())
    page.paragraph("The map: " + method + ".");
  page.figures(figures,
               "How far the map's density is from the posterior, order by order. At high "
               "orders the training rule underestimates it; the verified figure counts. The objective falls "
               "towards minus the log-evidence.");
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

std::string inference_report(const Json& content, const std::string& where) {
  try {
    const Content c(content);
    Page page("What the observations say", c.verdict);
    std::vector<Card> cards;
    for (std::size_t k = 0; k < std::min<std::size_t>(c.parameters.size(), 4); ++k)
      cards.push_back({c.parameters[k], record::with_uncertainty(c.mean[k], c.std[k]),
                       "most probable " + record::readable(c.most_probable[k], 4)});
    cards.push_back({"Trust", c.trusted ? "trusted" : "not trusted",
                     c.has_map() ? fmt::format("diagnostic {}, samples {} %",
                                               record::readable(content.at("variance_diagnostic"), 2),
                                               record::readable(100 * content.at("ess").get<double>(), 3))
                                 : fmt::format("effective sample size {} %",
                                               record::readable(100 * content.at("ess").get<double>(), 3)),
                     !c.trusted});
    cards.push_back({"Log-evidence",
                     record::with_uncertainty(content.at("log_evidence"),
                                              std::max(1e-6, content.at("log_evidence_error").get<double>())),
                     fmt::format("{} model evaluations", content.at("model_evaluations").get<long>())});
    page.cards(cards);
    add_parameters(page, c);
    add_pairs(page, c);
    if (c.has_map()) {
      add_pull_back(page, c);
      add_orders(page, content, c);
    }
    add_phases(page, content);
    add_provenance(page, content, c);
    return page.html();
  } catch (const Json::exception& error) {
    throw DataError(fmt::format("{}: not what `knothe infer` writes: {}", where, error.what()));
  }
}

void write_inference_report(const std::string& results_folder, const std::string& output) {
  const std::string path = (std::filesystem::path(results_folder) / "inference.json").string();
  files::write_text_atomically(output, inference_report(files::read_json(path), path));
}

}  // namespace knothe::report
