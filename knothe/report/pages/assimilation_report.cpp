#include "knothe/report/pages/assimilation_report.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <memory>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/figures/model_figures.hpp"
#include "knothe/report/figures/result_figures.hpp"
#include "knothe/report/figures/watch_figures.hpp"

namespace knothe::report {
namespace {

/// First of all: can the result be used?
void add_verdict(Page& page, const record::Results& results) {
  using Level = assimilation::VerdictLevel;
  if (!results.judged) return;
  const Level level = results.verdict.level;
  page.cards({{"Can this result be used?", to_text(level),
               level == Level::ok        ? "No problem found: the data fit the model and its noise."
               : level == Level::caution ? "Usable, with these caveats."
                                         : "Do not use it, for the reasons below.",
               level == Level::reject, level == Level::caution}});
  std::vector<TableRow> rows;
  for (const assimilation::VerdictReason& reason : results.verdict.reasons)
    rows.push_back({{to_text(reason.part), to_text(reason.level), reason.message}});
  if (!rows.empty()) page.table({"Verdict on", "level", "what it is, and what to do"}, rows);
  if (const auto& asked = results.refinement)
    page.note(
        fmt::format("The full-order model was run {:.0f} times in the region of the posterior, and the "
                    "reduced model refined: at the last step its error had been {:.2g} standard deviations.",
                    asked->full_order_runs, asked->moved_std));
}

void add_parameters(Page& page, const record::Results& results) {
  page.section("What the data say about the parameters");
  bool any = false;
  for (const auto& s : results.steps) any = any || !s.marginals.empty();
  std::vector<Figure> marginals, convergence;
  for (std::size_t d = 0; d < results.parameters.size(); ++d) {
    const std::string name = pretty_name(results.parameters[d].name);
    marginals.push_back(
        figure_of(marginals_plot(results, d), "Successive posterior marginals of " + name, 330.0));
    convergence.push_back(
        figure_of(convergence_plot(results, d), "Posterior mean and 95 % band of " + name, 280.0));
  }
  if (any) {
    page.figures(marginals,
                 "Successive posterior marginals, coloured by step. A flat curve means that the data so far "
                 "do not determine the parameter, a narrow one that they do. Moments, quantiles and "
                 "densities are importance-corrected.");
  } else {
    page.note("The results hold no marginal densities, so their figure is left out.");
  }
  page.figures(convergence,
               "Posterior mean, and the band that holds 95 % of the probability, after each step.");
  if (results.steps.empty()) return;
  for (const assimilation::EstimatedError& error : results.steps.back().lasting_errors) {
    const std::string value = record::with_uncertainty(error.mean, error.std);
    page.note(
        error.name == "time_offset"
            ? fmt::format("The data file's clock is {} ahead of the pictures', in their unit of time.", value)
            : fmt::format("The error that all values of {} share is {} of its standard deviations.",
                          error.name, value));
  }
}

/// Each pair of the first parameters; nothing for one parameter, or where the file has no draws.
void add_pairs(Page& page, const record::Results& results) {
  std::vector<Figure> figures;
  const std::size_t d = std::min<std::size_t>(results.draws.size(), 5);
  for (std::size_t row = 1; row < d; ++row)
    for (std::size_t column = 0; column < row; ++column)
      figures.push_back(
          figure_of(pair_plot(results, row, column), pretty_name(results.parameters[row].name) + " against " +
                                                         pretty_name(results.parameters[column].name)));
  if (figures.empty()) return;
  page.figures(figures,
               "Draws of the last posterior, pair by pair. A narrow ridge: the data determine one "
               "combination of the two much better than each of them.");
  if (results.draws.size() > d) page.note(fmt::format("Only the first {} parameters are drawn.", d));
}

void add_forecasts(Page& page, const record::Results& results) {
  page.section("Forecast");
  const auto names = results.forecast_names();
  if (names.empty()) {
    page.note("No forecast was asked for: a table [forecast.NAME] in the project file adds one.");
    return;
  }
  for (const auto& name : names) {
    std::vector<Figure> figures;
    const std::string title = forecast_scale(results, name).title;
    if (!results.steps.back().forecast.at(name).density.empty())
      figures.push_back(
          figure_of(forecast_densities_plot(results, name), title + ": successive densities", 330.0));
    figures.push_back(
        figure_of(forecast_convergence_plot(results, name), title + ": mean and 95 % band", 330.0));
    std::string caption =
        fmt::format("Forecast “{}”: what the posterior after each step predicts for the horizon.", name);
    if (const auto residual = results.steps.back().forecast.at(name).bridge_residual_rms)
      caption += fmt::format(" A crack of this length reproduces the predicted displacements to {} µm RMS.",
                             record::readable(1e6 * *residual, 2));
    page.figures(figures, caption);
  }
}

void add_method(Page& page, const record::Results& results) {
  page.section("How it was computed");
  const bool maps = results.has_maps();
  std::vector<Figure> figures = {
      figure_of(cost_plot(results), maps ? "Map order and time per step" : "Time per step", 300.0)};
  if (maps) {
    figures.push_back(figure_of(variance_diagnostic_plot(results), "Variance diagnostic", 300.0));
    figures.push_back(figure_of(sample_size_plot(results), "Effective sample size", 300.0));
  }
  const std::string by_maps =
      "Bars: polynomial order that the transport map needed at each step, 0 where quadrature did without "
      "one; line: time of the update, without the forecast. A step with a map is trusted if the diagnostic "
      "is at most 0.05, the effective sample size at least 90 %, and no second mode was found.";
  const std::string without_maps =
      "Time of the update, without the forecast. No step has a map. Quadrature is trusted if every other "
      "node gives the same evidence, means and standard deviations to 1 %, chains and particles if they have "
      "converged.";
  page.figures(figures, maps ? by_maps : without_maps);
  std::vector<TableRow> untrusted;
  for (const auto& s : results.steps)
    if (!s.trusted)
      untrusted.push_back(
          {{std::to_string(s.step), std::to_string(s.map_order), record::readable(s.variance_diagnostic, 2),
            record::readable(100.0 * s.effective_sample_size, 3) + " %", s.remark}});
  if (!untrusted.empty())
    page.table({"not trusted: step", "order", "diagnostic", "samples", "remark"}, untrusted);
  std::size_t rejected = 0, missing = 0;
  for (const auto& s : results.steps) rejected += s.rejected, missing += s.missing;
  if (rejected + missing > 0)
    page.paragraph(fmt::format("{} values were missing and {} were rejected.", missing, rejected));
}

void add_learning(Page& page, const record::Results& results) {
  page.section("Which steps carry information");
  std::vector<Figure> figures;
  if (!results.displacement.empty())
    figures.push_back(
        figure_of(load_plot(results), "Load–displacement curve and the most informative steps", 330.0));
  else if (results.residuals.series.empty())
    page.note("The results hold no load–displacement curve, so it is left out.");
  figures.push_back(figure_of(information_plot(results), "Information gained per step", 330.0));
  page.figures(figures,
               fmt::format("{}Bars: entropy reduction of the posterior at each step.",
                           results.displacement.empty()
                               ? ""
                               : "Dots: the five steps where the standard deviation of a parameter falls by "
                                 "the largest factor. "));
}

/// The last posterior mean, moved into the model's box, in the model's order of parameters; the box's middle
/// for a parameter that the results do not have.
std::vector<double> drawing_point(const record::Results& results, const model::SeparatedModel& model) {
  std::vector<double> p;
  for (const auto& axis : model.contents().axes) {
    double value = 0.5 * (axis.nodes.front() + axis.nodes.back());
    for (std::size_t d = 0; d < results.parameters.size(); ++d)
      if (results.parameters[d].name == axis.name) value = results.steps.back().mean[d];
    p.push_back(std::clamp(value, axis.nodes.front(), axis.nodes.back()));
  }
  return p;
}

void add_model(Page& page, const record::Results& results, const model::SeparatedModel& model) {
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
  const std::vector<double> p = drawing_point(results, model);
  if (can_be_drawn(model)) {
    const std::size_t last = contents.time.size() - 1;
    page.figure(displacement_figure(model, p, last),
                "Horizontal displacement at the last time step and the posterior mean.");
    page.figures(space_mode_figures(model),
                 "The first space modes on the outer face (horizontal component, largest value 1, "
                 "deformed shape exaggerated).");
  } else if (contents.quantities.empty()) {
    page.note("The model file has no mesh of hexahedra with displacement dofs, so its fields are not drawn.");
  }
  std::vector<Figure> functions = {figure_of(time_functions_plot(model, p), "Time functions", 300.0)};
  for (std::size_t axis = 0; axis < contents.axes.size(); ++axis)
    functions.push_back(figure_of(parameter_functions_plot(model, axis, p), "Parameter functions", 300.0));
  page.figures(functions,
               contents.form == model::Form::canonical
                   ? "Time functions at the posterior mean, and parameter functions, of the first modes."
                   : "Time functions at the posterior mean, and the joint parameter functions along lines "
                     "through it, of the first modes.");
  if (can_be_drawn(model) && !contents.crack.empty()) {
    const std::vector<double> lengths = {0.0, 0.025, 0.05, 0.075};
    page.figures(crack_figures(model, lengths),
                 "Elastic solutions of the crack bridge for four crack lengths and a unit "
                 "imposed displacement (the paper's Fig. 10).");
  }
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
  Page page(project.empty() ? "Test report" : "Test report: " + project,
            fmt::format("{}{} assimilated, up to model time {}. Last step: {} of {} used.", date,
                        counted(results.steps.size(), "step"), record::plain(last.time), last.used,
                        counted(last.used + last.rejected + last.missing, "sensor")));
  add_verdict(page, results);
  page.cards(headline(results));
  add_parameters(page, results);
  add_pairs(page, results);
  add_forecasts(page, results);
  add_learning(page, results);
  add_watch(page, results, model);
  add_method(page, results);
  if (model != nullptr) {
    add_model(page, results, *model);
  } else {
    page.section("The reduced model").note("The figures of the model are left out: " + model_problem);
  }
  if (const auto rows = comparison_with_paper(results); !rows.empty()) {
    page.section("Comparison with the paper");
    page.paragraph(
        "Rubio, Chamoin and Louf, Comptes Rendus Mécanique 347 (2019), §6.3, with synthetic data of their "
        "own.");
    page.table({"", "paper", "here", "why they differ"}, rows);
  }
  add_provenance(page, results);
  return page.html();
}

void write_assimilation_report(const std::string& results_folder, const std::string& model_path,
                               const std::string& output) {
  const record::Results results = record::read_results(results_folder);
  const std::string path = model_path.empty() ? results.model : model_path;
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

std::string overview_svg(const record::Results& results) {
  Figure figure{"Successive posteriors and forecasts", {}, 2, 470.0, 330.0};
  const auto names = results.forecast_names();
  const std::size_t shown = names.empty() ? results.parameters.size() : 1;
  for (std::size_t i = 0; i < std::min<std::size_t>(shown, 2); ++i)
    figure.plots.push_back(marginals_plot(results, names.empty() ? i : results.parameters.size() - 1));
  for (std::size_t i = 0; i < std::min<std::size_t>(names.size(), 1); ++i)
    figure.plots.push_back(forecast_densities_plot(results, names[i]));
  return standalone_svg(figure);
}

void write_overview_svg(const std::string& results_folder, const std::string& output) {
  files::write_text_atomically(output, overview_svg(record::read_results(results_folder)));
}

}  // namespace knothe::report
