#include "knothe/report/pages/assimilation_report.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/record/forecast_text.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/data/report_record.hpp"
#include "knothe/report/data/words.hpp"
#include "knothe/report/pages/fit_section.hpp"

namespace knothe::report {
namespace {

using Level = assimilation::VerdictLevel;

/// First of all: can the result be used?
void add_result(Page& page, const record::Results& results) {
  if (!results.judged) return;
  const assimilation::Verdict& verdict = results.verdict;
  std::vector<std::string> sentences;
  if (verdict.level == Level::ok)
    sentences.push_back("Verdict: no problem found; the data fit the model and its noise.");
  for (const assimilation::VerdictReason& reason : verdict.reasons)
    sentences.push_back(fmt::format("Verdict on {} ({}): {}", to_text(reason.part),
                                    result_words(usability(reason.level)), reason.message));
  if (const auto& asked = results.refinement)
    sentences.push_back(
        fmt::format("The full-order model was run {:.0f} times in the region of the posterior, and the "
                    "reduced model refined: at the last step its error had been {:.2g} standard deviations.",
                    asked->full_order_runs, asked->moved_std));
  page.result(usability(verdict.level), sentences);
}

/// What to do next, of a project that asks.
void add_next(Page& page, const record::Results& results) {
  if (auto decision = results.steps.back().decision) {
    decision->time_units = results.time_units;
    page.next(record::action_text(*decision), decision->message);
  }
}

/// Of the first screen: the specimen, what was measured, the load curve; then the numbers.
void add_first_screen(Page& page, const record::Results& results, const nlohmann::ordered_json& record) {
  std::vector<FigurePlace> figures;
  if (record.contains("specimen") || record.contains("sensors"))
    figures.push_back({"specimen", "Specimen and sensors, shape of the posterior mean"});
  if (record.contains("measured"))
    figures.push_back({"measured:0", "Measured, predicted: " + measured_title(record, 0)});
  if (record.contains("load")) figures.push_back({"load", "Load over displacement, last posterior"});
  page.figures(figures);
  page.tables(headline(results));
  page.note(
      "After the last step. ±: one standard deviation of the posterior, with the reduced model's error where "
      "it is known. 95 %: from the 2.5 % to the 97.5 % quantile, of the posterior alone.");
}

void add_parameters(Page& page, const record::Results& results) {
  page.section("What the data say about the parameters");
  bool any = false;
  for (const auto& s : results.steps) any = any || !s.marginals.empty();
  std::vector<FigurePlace> figures;
  const auto add_each = [&](const char* kind, const char* title) {
    for (std::size_t d = 0; d < results.parameters.size(); ++d)
      figures.push_back({fmt::format("{}:{}", kind, d),
                         fmt::format(fmt::runtime(title), pretty_name(results.parameters[d].name))});
  };
  if (any) add_each("marginal", "Posterior of {}, step by step");
  add_each("parameter", "{} as the data come in");
  if (results.parameters.size() > 1 && !results.draws.empty())
    figures.push_back({"pairs", "Draws of the last posterior, pair by pair"});
  page.figures(figures,
               "A flat density means that the data so far do not determine the parameter, a narrow one that "
               "they do; a narrow ridge of draws, that they determine one combination of two parameters much "
               "better than each. Moments, quantiles and densities are importance-corrected.");
  if (!any) page.note("The results hold no marginal densities, so their figure is left out.");
  for (const assimilation::EstimatedError& error : results.steps.back().lasting_errors) {
    const std::string value = record::with_uncertainty(error.mean, error.std);
    const std::size_t dot = error.name.rfind('.');
    const std::string whose = dot == std::string::npos ? "data file" : "source " + error.name.substr(0, dot);
    if (error.name.ends_with("time_offset"))
      page.note(fmt::format("The clock of the {} is {} ahead, in the data's unit of time.", whose, value));
    else if (error.name.ends_with("time_drift"))
      page.note(fmt::format("The clock of the {} runs faster by a share of {}.", whose, value));
    else
      page.note(fmt::format("The error of {} that all data share is {} of its standard deviations.",
                            error.name, value));
  }
}

std::string input_name(const std::string& name) {
  static const std::map<std::string, std::string> known = {{"displacements", "displacements (pixel size)"},
                                                           {"clock", "clock (imposed displacement)"},
                                                           {"displacements and clock", "both of these"},
                                                           {"youngs_modulus", "Young's modulus"}};
  const auto found = known.find(name);
  return found == known.end() ? name : found->second;
}

/// What the posterior does not say: errors of the inputs that no test of the data detects.
void add_input_errors(Page& page, const record::Results& results) {
  if (results.input_shifts.empty()) return;
  Table table{"If an input is too large", {"input"}, {}, worth_of(results)};
  for (const record::ParameterSummary& p : results.parameters)
    table.header.push_back(pretty_name(p.name) + " shifts by");
  for (const assimilation::InputShift& error : results.input_shifts) {
    TableRow row{
        {fmt::format("{} by {}\u00a0%{}", input_name(error.name), record::plain(100 * error.relative),
                     error.is_limited ? " (the data would show more)" : "")}};
    for (Eigen::Index a = 0; a < error.shift.size(); ++a)
      row.cells.push_back(fmt::format("{}{}\u00a0σ ({})", error.in_std[a] < 0 ? "" : "+",
                                      record::readable(error.in_std[a], 2),
                                      record::readable(error.shift[a], 2)));
    table.rows.push_back(std::move(row));
  }
  page.tables({table});
  page.note(
      "σ: one standard deviation of the posterior, which does not contain these errors: with other "
      "parameters the data still fit. [tolerances] in the project file says how well each input is known; "
      "the tests of the fit detect larger errors.");
}

void add_forecasts(Page& page, const record::Results& results) {
  page.section("Forecast");
  std::vector<std::string> names = results.forecast_names();
  if (names.empty()) {
    page.note("No forecast was asked for: a table [forecast.NAME] in the project file adds one.");
    return;
  }
  const auto& last = results.steps.back().forecast;
  std::stable_partition(names.begin(), names.end(),
                        [&](const std::string& name) { return !last.at(name).is_past; });
  std::vector<FigurePlace> figures;
  for (const auto& name : names) {
    const std::string title = forecast_scale(results, name).title;
    figures.push_back({"forecast:" + name, title + ", as the data come in"});
    if (!last.at(name).density.empty())
      figures.push_back({"forecast_density:" + name, title + ": densities"});
  }
  page.figures(figures, "What the posterior after each step predicts for the horizon.");
  for (const auto& name : names)
    if (const auto residual = last.at(name).bridge_residual_rms)
      page.note(fmt::format("{}: a crack of this length reproduces the predicted displacements to {} µm RMS.",
                            name, record::readable(1e6 * *residual, 2)));
}

void add_decisions(Page& page, const record::Results& results) {
  if (!results.steps.back().decision) return;
  page.section("Decisions");
  page.figures({{"decisions", "What was decided after each step"},
                {"risk", "Probability of failure of what was decided, and the allowed one"}},
               "Load, hold or stop after each step, and the furthest load that the stated risk of failure "
               "allowed then.");
}

void add_learning(Page& page, const record::Results& results) {
  page.section("Which steps carry information");
  if (results.displacement.empty() && results.residuals.series.empty())
    page.note("The results hold no load–displacement curve, so it is left out.");
  page.figures({{"information", "Information gained at each step"}},
               "How far the entropy of the posterior falls.");
  for (std::size_t d = 0; d < results.parameters.size(); ++d) {
    std::vector<std::size_t> steps;
    for (const std::size_t i : learning_steps(results, d)) steps.push_back(results.steps[i].step);
    if (!steps.empty())
      page.paragraph(fmt::format("The standard deviation of {} falls most at steps {}.",
                                 pretty_name(results.parameters[d].name), list_of(steps)));
  }
}

void add_method(Page& page, const record::Results& results) {
  page.section("How it was computed");
  const bool maps = results.has_maps();
  const std::size_t n = results.steps.size();
  const auto untrusted = results.untrusted();
  page.paragraph(fmt::format("The computation is trusted at {}. Time of an update without forecasts: {}.",
                             untrusted.empty() ? fmt::format("all {} steps", n)
                                               : fmt::format("{} of {} steps; not trusted: {}",
                                                             n - untrusted.size(), n, list_of(untrusted)),
                             update_times(results, &record::Step::update_us)));
  std::vector<FigurePlace> figures = {{"timing", "Time of an update, by phase"}};
  if (maps) {
    figures.push_back({"order", "Order of the transport map"});
    figures.push_back({"diagnostic", "Variance diagnostic of the map"});
  }
  page.figures(figures,
               maps
                   ? "Order 0: quadrature did without a map. A step with a map is trusted if the diagnostic "
                     "is at most 0.05, the effective sample size at least 90 %, and no second mode was found."
                   : "No step has a map. Quadrature is trusted if every other node gives the same evidence, "
                     "means and standard deviations to 1 %, chains and particles if they have converged.");
  std::vector<TableRow> rows;
  for (const auto& s : results.steps)
    if (!s.trusted)
      rows.push_back(
          {{std::to_string(s.step), std::to_string(s.map_order), record::readable(s.variance_diagnostic, 2),
            record::readable(100.0 * s.effective_sample_size, 3) + " %", s.remark}});
  if (!rows.empty()) page.table({"not trusted: step", "order", "diagnostic", "samples", "remark"}, rows);
  std::size_t rejected = 0, missing = 0;
  for (const auto& s : results.steps) rejected += s.rejected, missing += s.missing;
  if (rejected + missing > 0)
    page.paragraph(fmt::format("{} values were missing and {} were rejected.", missing, rejected));
}

void add_model(Page& page, const model::SeparatedModel& model, const nlohmann::ordered_json& record) {
  const auto& contents = model.contents();
  page.section("The reduced model");
  const auto error = [&](double relative, double largest) {
    const bool is_displacement = contents.quantities.empty() && contents.field.units == "m";
    return fmt::format(
        "{} relative, at most {}", record::readable(relative, 2),
        is_displacement ? record::readable(1e6 * largest, 2) + " µm"
        : contents.quantities.empty()
            ? record::readable(largest, 2) + " " + pretty_units(contents.field.units)
            : record::readable(largest, 2) + " of how much the quantity varies (root mean square)");
  };
  const auto& between = contents.off_grid;
  page.paragraph(fmt::format(
      "Separated in the {} form: {} space modes, {} parameter functions, {} time steps, {} degrees of "
      "freedom. Error on its training grid: {}. Off the grid: {}.",
      model::to_text(contents.form), contents.space_modes, contents.parameter_modes, contents.time.size(),
      contents.dof_count(), error(contents.relative_error, contents.max_error_m),
      between ? error(between->relative_error, between->max_error_m) + " (" + between->source + ")"
              : "not known"));
  std::vector<FigurePlace> figures;
  if (record.contains("specimen")) {
    for (const auto& [kind, member] : {std::pair("mode", "modes"), std::pair("crack", "crack")})
      for (const auto& [key, field] : record.at("specimen").at(member).items())
        figures.push_back({fmt::format("{}:{}", kind, key), field.at("title").get<std::string>()});
  } else if (contents.quantities.empty()) {
    page.note("The model file has no mesh of hexahedra with displacement dofs, so its fields are not drawn.");
  }
  figures.push_back({"functions:0", "Time functions at the posterior mean"});
  for (std::size_t axis = 0; axis < contents.axes.size(); ++axis)
    figures.push_back({fmt::format("functions:{}", axis + 1),
                       "Parameter functions along " + pretty_name(contents.axes[axis].name)});
  page.figures(figures,
               contents.form == model::Form::canonical
                   ? "The first modes, deformed shapes exaggerated."
                   : "The first modes, deformed shapes exaggerated; the joint parameter functions along "
                     "lines through the posterior mean.");
}

void add_provenance(Page& page, const record::Results& results) {
  page.section("Provenance");
  if (!results.summary_found)
    page.note(
        "summary.json is missing: the assimilation was interrupted, or these are not all of its files.");
  std::vector<TableRow> rows;
  const auto add = [&](const std::string& what, const std::string& value) {
    if (!value.empty()) rows.push_back({{what, value}});
  };
  add("Program", results.created_by);
  add("Model", results.model);
  add("Data", results.data);
  add("Seed", results.seed);
  add("Steps", fmt::format("{} (from {} to {})", results.steps.size(), results.steps.front().step,
                           results.steps.back().step));
  if (results.elapsed_s) add("Time of the whole run", record::readable(*results.elapsed_s, 3) + " s");
  for (const auto& p : results.parameters)
    if (!p.prior.empty()) {
      std::string prior = p.prior;
      if (p.lower && p.upper)
        prior += fmt::format(", on {} … {}", record::plain(*p.lower), record::plain(*p.upper));
      if (p.reference && *p.reference != 1)
        prior += fmt::format("; 1 means {} {}", record::plain(*p.reference),
                             p.units.empty() || p.units == "1" ? "in SI units" : pretty_units(p.units));
      add("Prior of " + pretty_name(p.name), prior);
    }
  for (const auto& [name, value] : results.machine) add("Machine: " + name, value);
  page.table({}, rows);
  if (!results.project.empty()) page.details("The project file", results.project);
}

}  // namespace

std::string assimilation_report(const record::Results& results, const model::SeparatedModel* model,
                                const std::string& model_problem) {
  const record::Step& last = results.steps.back();
  // "2026-11-25T16:02:11.123Z" to the minute.
  const std::string& at = results.computed_at;
  const std::string date =
      at.size() < 16 ? "" : fmt::format("{} {} UTC. ", at.substr(0, 10), at.substr(11, 5));
  const std::string project = std::filesystem::path(results.project_file).filename().string();
  Page page(
      project.empty() ? "Test report" : "Test report: " + project,
      fmt::format("{}{} assimilated, up to model time {}. Last step: {} of {} used.", date,
                  counted(results.steps.size(), "step"), record::given_text(last.time, results.time_units),
                  last.used, counted(last.used + last.rejected + last.missing, "sensor")));
  const nlohmann::ordered_json record = assimilation_record(results, model);
  add_result(page, results);
  add_next(page, results);
  add_first_screen(page, results, record);
  add_fit(page, results, record);
  add_parameters(page, results);
  add_input_errors(page, results);
  add_forecasts(page, results);
  add_decisions(page, results);
  add_learning(page, results);
  add_method(page, results);
  if (model != nullptr) {
    add_model(page, *model, record);
  } else {
    page.section("The reduced model").note("The figures of the model are left out: " + model_problem);
  }
  if (const auto rows = comparison_with_paper(results); !rows.empty()) {
    page.section("Comparison with the paper");
    page.paragraph(
        "Rubio, Chamoin and Louf, Comptes Rendus Mécanique 347 (2019), §6.3, with synthetic data of their "
        "own.");
    page.table({"quantity", "paper", "here", "why they differ"}, rows);
  }
  add_provenance(page, results);
  return page.html(record);
}

void write_assimilation_report(const std::string& results_folder, const std::string& model_path,
                               const std::string& output) {
  const record::Results results = record::read_results(results_folder);
  const std::string path = model_path.empty() ? results.model_path : model_path;
  std::unique_ptr<model::SeparatedModel> model;
  std::string problem = "no model file is named in summary.json";
  if (!path.empty()) {
    try {
      model = std::make_unique<model::SeparatedModel>(model::SeparatedModel::load(path));
    } catch (const Error& e) {
      problem = e.what();
    }
  }
  files::write_text_atomically(output, assimilation_report(results, model.get(), problem));
}

}  // namespace knothe::report
