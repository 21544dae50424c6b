#include "knothe/report/figures/watch_figures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "knothe/record/number_text.hpp"
#include "knothe/report/figures/mesh_view.hpp"
#include "knothe/report/figures/model_figures.hpp"
#include "knothe/report/figures/result_figures.hpp"

namespace knothe::report {
namespace {

/// A step at which the alarm goes off: at the one before it was silent.
std::vector<std::size_t> alarms(const record::Results& results) {
  std::vector<std::size_t> at;
  for (std::size_t i = 0; i < results.steps.size(); ++i) {
    if (results.steps[i].monitor.alarm && (i == 0 || !results.steps[i - 1].monitor.alarm)) at.push_back(i);
  }
  return at;
}

void mark_alarms(Plot& plot, const record::Results& results, const std::vector<double>& y) {
  std::vector<double> x, at;
  for (const std::size_t i : alarms(results)) {
    x.push_back(results.steps[i].step);
    at.push_back(y[i]);
  }
  if (!x.empty()) plot.scatter(x, at, Paint::truth(), "alarm", 4.5);
}

std::string verdict(const record::Results& results) {
  const auto rang = alarms(results);
  if (!rang.empty()) {
    std::string steps;
    for (const std::size_t i : rang)
      steps += fmt::format("{}{}", steps.empty() ? "" : ", ", results.steps[i].step);
    return fmt::format(
        "The alarm was raised at step {}: from some steps before on, the data differ from what the model "
        "predicted given all earlier data. A sensor that moved, a wrong noise level, a structure that "
        "changed and a wrong model all raise it.",
        steps);
  }
  double nearest = 0;
  for (const record::Step& s : results.steps)
    if (s.monitor.threshold > 0) nearest = std::max(nearest, s.monitor.cumulative_sum / s.monitor.threshold);
  return fmt::format(
      "The alarm was not raised: each datum was compared with its prediction from the posterior before it, "
      "and the misfit statistic peaked at {:.0f} % of its alarm threshold.",
      100 * nearest);
}

/// What of an axis is shown where the sensors have these coordinates (m), in mm: they and a margin.
PlotAxis axis_around(const std::string& label, const std::vector<double>& sensors, double margin) {
  return {label, 1e3 * std::ranges::min(sensors) - margin, 1e3 * std::ranges::max(sensors) + margin};
}

/// Largest extent of the sensors along x and y, mm.
double extent_of_sensors(const record::Residuals& r) {
  return 1e3 * std::max({std::ranges::max(r.x) - std::ranges::min(r.x),
                         std::ranges::max(r.y) - std::ranges::min(r.y), 1e-9});
}

/// A height at which a map of 460 px is filled by its sensors.
double map_height(const record::Residuals& r) {
  const double high = 1e3 * (std::ranges::max(r.y) - std::ranges::min(r.y)) / extent_of_sensors(r);
  return std::clamp(90.0 + 330.0 * (high + 0.2), 190.0, 420.0);
}

constexpr std::size_t k_shown_series = 8;

std::vector<Figure> series_figures(const record::Results& results) {
  std::vector<Figure> figures;
  for (const auto& [name, fit] : results.residuals.series) {
    if (figures.size() == k_shown_series) break;
    figures.push_back(figure_of(series_plot(name, fit), name + " as measured and as predicted"));
  }
  if (!figures.empty())
    figures.push_back(figure_of(series_residual_plot(results), "Residuals of the series over the steps"));
  return figures;
}

std::vector<Figure> residual_figures(const record::Results& results, const model::SeparatedModel* model) {
  if (results.residuals.step.empty()) return {};
  std::vector<Figure> figures = {
      figure_of(residual_plot(results), "Residuals at the sensors over the steps")};
  if (!results.residuals.measured.empty())
    figures.push_back(figure_of(measured_plot(results), "Measured against predicted at the last step"));
  std::set<char> components(results.residuals.component.begin(), results.residuals.component.end());
  for (const char c : components)
    figures.push_back(figure_of(residual_map(results, c, model),
                                fmt::format("Residuals of u_{} at the sensors", c),
                                map_height(results.residuals)));
  return figures;
}

void add_residuals(Page& page, const record::Results& results, const model::SeparatedModel* model) {
  if (const auto figures = residual_figures(results, model); !figures.empty())
    page.figures(figures,
                 "Residuals: measured values minus the posterior mean prediction at the same step. If only "
                 "noise is left, the curve is flat and the map shows no pattern. (Camera motion that is "
                 "removed from pictures is still contained in the residuals.)");
  if (const auto figures = series_figures(results); !figures.empty())
    page.figures(figures,
                 "Predicted: the mean over the posterior that has the datum. If only noise is left, most "
                 "residuals are within ±2 and have no trend.");
  if (results.residuals.series.size() > k_shown_series)
    page.note(fmt::format("Only the first {} series are drawn.", k_shown_series));
}

}  // namespace

Plot evidence_plot(const record::Results& results) {
  Plot plot("Evidence of each step", {"step"}, {"log-evidence increment"});
  const auto increment =
      record::over_steps(results, [](const record::Step& s) { return s.log_evidence_increment; });
  plot.line(results.step_numbers(), increment, Paint::faint(), "of the step", {1.2});
  if (results.monitored)
    plot.line(results.step_numbers(),
              record::over_steps(results, [](const record::Step& s) { return s.monitor.smoothed_increment; }),
              Paint::series(6), "smoothed", {2.2});
  mark_alarms(plot, results, increment);
  return plot;
}

Plot alarm_plot(const record::Results& results) {
  const auto sum =
      record::over_steps(results, [](const record::Step& s) { return s.monitor.cumulative_sum; });
  const double threshold = results.steps.back().monitor.threshold;
  Plot plot("The alarm", {"step"},
            {"cumulative sum", 0.0, 1.15 * std::max(threshold, *std::max_element(sum.begin(), sum.end()))});
  plot.line(results.step_numbers(), sum, Paint::series(0), "largest of the sums");
  plot.horizontal(threshold, Paint::truth(), "threshold");
  mark_alarms(plot, results, sum);
  return plot;
}

Plot residual_plot(const record::Results& results) {
  std::vector<double> x, y;
  for (std::size_t i = 0; i < results.residuals.step.size(); ++i) {
    x.push_back(results.residuals.step[i]);
    y.push_back(1e6 * results.residuals.step_rms[i]);
  }
  Plot plot("Measured minus predicted, all sensors", {"step"}, {"root mean square (µm)", 0.0});
  const bool has_noise = !results.residuals.noise_rms.empty();
  plot.line(x, y, Paint::series(1), has_noise ? "measured minus predicted" : "");
  if (!has_noise) return plot;
  std::vector<double> noise;
  for (const double rms : results.residuals.noise_rms) noise.push_back(1e6 * rms);
  plot.line(x, noise, Paint::truth(), "noise of the sensors", {1.6, "6 4", 1.0});
  return plot;
}

Plot measured_plot(const record::Results& results) {
  std::vector<double> measured, predicted;
  // More than some thousand dots are neither seen nor quickly shown.
  const std::size_t stride = 1 + results.residuals.measured.size() / 4000;
  for (std::size_t i = 0; i < results.residuals.measured.size(); i += stride) {
    measured.push_back(1e6 * results.residuals.measured[i]);
    predicted.push_back(1e6 * results.residuals.predicted[i]);
  }
  const auto [low, high] = std::minmax_element(predicted.begin(), predicted.end());
  const std::vector<double> ends = {*low, *high};
  Plot plot("Measured against predicted, last step", {"predicted (µm)"}, {"measured (µm)"});
  plot.line(ends, ends, Paint::faint(), "equal", {1.2});
  plot.scatter(predicted, measured, Paint::series(0), "a sensor", 2.2);
  return plot;
}

Plot series_plot(const std::string& name, const record::SeriesFit& fit) {
  const UnitScale scale = unit_scale(fit.units);
  const auto shown = [&](std::vector<double> values) {
    for (double& value : values) value *= scale.factor;
    return values;
  };
  Plot plot(name + ", measured and predicted", {"step"},
            {scale.unit.empty() ? name : fmt::format("{} ({})", name, scale.unit)});
  plot.line(fit.step, shown(fit.predicted), Paint::series(0), "posterior mean prediction");
  plot.scatter(fit.step, shown(fit.measured), Paint::series(1), "measured", 2.2);
  return plot;
}

Plot series_residual_plot(const record::Results& results) {
  Plot plot("Measured minus predicted", {"step"}, {"in standard deviations of the noise"});
  int colour = 0;
  for (const auto& [name, fit] : results.residuals.series) {
    if (colour == static_cast<int>(k_shown_series) || !(fit.std > 0)) continue;
    std::vector<double> y;
    for (std::size_t i = 0; i < fit.step.size(); ++i)
      y.push_back((fit.measured[i] - fit.predicted[i]) / fit.std);
    plot.line(fit.step, y, Paint::series(colour++), name, {1.4});
  }
  for (const double limit : {-2.0, 2.0}) plot.horizontal(limit, Paint::faint(), "±2");
  return plot;
}

Plot discrepancy_plot(const record::Results& results) {
  Plot plot("Inferred size of the model discrepancy", {"step"}, {"size of the discrepancy", 0.0});
  plot.line(results.step_numbers(),
            record::over_steps(results, [](const record::Step& s) { return s.monitor.discrepancy; }),
            Paint::series(1));
  return plot;
}

Plot residual_map(const record::Results& results, char component, const model::SeparatedModel* model) {
  const record::Residuals& r = results.residuals;
  double top = 0;
  for (std::size_t i = 0; i < r.x.size(); ++i)
    if (r.component[i] == component) top = std::max(top, std::abs(r.mean[i]));
  const double extent = extent_of_sensors(r), half = 0.01 * extent, margin = 0.1 * extent;
  // More than some thousand squares are neither seen nor quickly shown.
  const std::size_t stride = 1 + r.x.size() / 4000;
  std::vector<Cell> cells;
  for (std::size_t i = 0; i < r.x.size(); i += stride) {
    if (r.component[i] != component) continue;
    const double x = 1e3 * r.x[i], y = 1e3 * r.y[i];
    cells.push_back({{{x - half, y - half}, {x + half, y - half}, {x + half, y + half}, {x - half, y + half}},
                     blue_white_red(top > 0 ? 0.5 + 0.5 * r.mean[i] / top : 0.5)});
  }
  Plot plot(fmt::format("u_{}: mean residual of the last {} steps", component, r.averaged),
            axis_around("x (mm)", r.x, margin), axis_around("y (mm)", r.y, margin));
  plot.cells(std::move(cells)).equal_scales();
  if (model != nullptr && can_be_drawn(*model))
    for (const auto& [from, to] : outline(outer_face(*model->contents().mesh)))
      plot.line(std::array{1e3 * from[0], 1e3 * to[0]}, std::array{1e3 * from[1], 1e3 * to[1]},
                Paint::faint(), {}, {1.2});
  plot.colour_bar({"µm", -1e6 * top, 1e6 * top, ColourBar::Map::blue_white_red});
  return plot;
}

Plot model_probability_plot(const record::Results& results) {
  Plot plot("Which model", {"step"}, {"posterior probability", 0.0, 1.02});
  int colour = 0;
  for (const auto& [name, last] : results.steps.back().models) {
    std::vector<double> x, y;
    for (const record::Step& s : results.steps) {
      const auto found = s.models.find(name);
      if (found == s.models.end()) continue;
      x.push_back(s.step);
      y.push_back(found->second.probability);
    }
    plot.line(x, y, Paint::series(colour++), name, {2.0});
  }
  return plot;
}

void add_watch(Page& page, const record::Results& results, const model::SeparatedModel* model) {
  page.section("Does the model fit the data?");
  if (!results.monitored) {
    page.note("These results hold no record of the evidence monitor.");
    return;
  }
  page.paragraph(verdict(results));
  std::vector<Figure> figures = {
      figure_of(evidence_plot(results), "Log-evidence increments"),
      figure_of(alarm_plot(results), "Cumulative sum of the monitor and its threshold")};
  const bool joint = std::any_of(results.steps.begin(), results.steps.end(),
                                 [](const record::Step& s) { return s.monitor.discrepancy > 0; });
  if (joint) figures.push_back(figure_of(discrepancy_plot(results), "Size of the discrepancy"));
  if (!results.steps.back().models.empty())
    figures.push_back(figure_of(model_probability_plot(results), "Posterior probability of each model"));
  page.figures(figures,
               fmt::format("The evidence of a step is the log-probability density that the model assigned to "
                           "its data before assimilating them. The monitor sums a score of each prediction; "
                           "a correct model exceeds the threshold once in 17,280 steps on average.{}",
                           joint ? " Size of the discrepancy: posterior mean of κ, the model's error "
                                   "relative to the prior standard deviation of its prediction."
                                 : ""));
  std::vector<TableRow> notices;
  for (const record::Step& s : results.steps)
    if (!s.notice.empty()) notices.push_back({{std::to_string(s.step), s.notice}});
  if (!notices.empty()) page.table({"step", "what the monitor found or did"}, notices);
  if (!results.steps.back().models.empty()) {
    std::vector<TableRow> rows;
    for (const auto& [name, m] : results.steps.back().models)
      rows.push_back({{name, record::readable(m.probability, 3), record::readable(m.log_evidence, 8),
                       record::readable(m.log_bayes_factor, 3)}});
    page.table({"model", "probability", "log-evidence", "log Bayes factor of the best over it"}, rows);
  }
  add_residuals(page, results, model);
}

}  // namespace knothe::report
