#include <algorithm>
#include <cmath>

#include "knothe/record/number_text.hpp"
#include "knothe/report/figures/result_figures.hpp"

namespace knothe::report {
namespace {

std::vector<double> scaled(const std::vector<double>& values, double factor) {
  std::vector<double> out(values);
  for (double& v : out) v *= factor;
  return out;
}

/// The part of the axis where any density is worth seeing: above a thousandth of the lowest peak.
void limit_to_mass(const record::Results& results, const std::string& name, double factor, PlotAxis& axis) {
  double low = INFINITY, high = -INFINITY;
  for (const auto& s : results.steps) {
    const auto found = s.forecast.find(name);
    if (found == s.forecast.end() || found->second.density.empty()) continue;
    const record::DensityCurve& density = found->second.density;
    const double peak = *std::max_element(density.values.begin(), density.values.end());
    for (std::size_t i = 0; i < density.points.size(); ++i)
      if (density.values[i] > 2e-3 * peak)
        low = std::min(low, density.points[i]), high = std::max(high, density.points[i]);
  }
  if (low < high) axis.low = factor * low, axis.high = factor * high;
}

std::string with_capital(std::string text) {
  if (!text.empty() && text[0] >= 'a' && text[0] <= 'z') text[0] = text[0] - 'a' + 'A';
  std::replace(text.begin(), text.end(), '_', ' ');
  return text;
}

}  // namespace

ForecastScale forecast_scale(const record::Results& results, const std::string& name) {
  const auto found = results.forecasts.find(name);
  record::ForecastSummary summary =
      found == results.forecasts.end() ? record::ForecastSummary{} : found->second;
  if (const auto last = results.steps.back().forecast.find(name);
      summary.unit.empty() && last != results.steps.back().forecast.end())
    summary.unit = last->second.units;
  ForecastScale scale;
  scale.crack = summary.quantity == "crack_length" || (summary.quantity.empty() && name.find("crack") == 0);
  scale.quantity = scale.crack ? "Equivalent elastic crack length" : with_capital(name);
  scale.title = scale.quantity;
  if (summary.horizon)
    scale.title += " at time " + record::plain(*summary.horizon);
  else if (scale.crack && name != "crack")
    scale.title += " (" + name + ")";
  const UnitScale shown = unit_scale(scale.crack ? "m" : summary.unit);
  scale.unit = shown.unit, scale.factor = shown.factor;
  return scale;
}

Plot forecast_densities_plot(const record::Results& results, const std::string& name) {
  const ForecastScale scale = forecast_scale(results, name);
  PlotAxis x{scale.label()};
  limit_to_mass(results, name, scale.factor, x);
  std::vector<double> peaks;
  for (const record::Step& s : results.steps)
    if (const auto found = s.forecast.find(name); found != s.forecast.end() && !found->second.density.empty())
      peaks.push_back(std::ranges::max(found->second.density.values) / scale.factor);
  const PlotAxis y = density_axis(scale.unit.empty() ? "" : "1/" + scale.unit, peaks);
  Plot plot(scale.title, x, y);
  const double first = results.steps.front().step;
  const double span = std::max((results.steps.back().step) - first, 1.0);
  for (std::size_t i = 0; i < results.steps.size(); ++i) {
    const auto found = results.steps[i].forecast.find(name);
    if (found == results.steps[i].forecast.end() || found->second.density.empty()) continue;
    const record::DensityCurve& density = found->second.density;
    const bool last = i + 1 == results.steps.size();
    plot.line(scaled(density.points, scale.factor),
              density_values(scaled(density.values, 1.0 / scale.factor), y),
              Paint::time(((results.steps[i].step) - first) / span), last ? "last step" : "",
              {last ? 2.8 : 1.2, {}, 1.0});
  }
  if (const auto f = results.forecasts.find(name); f != results.forecasts.end() && f->second.threshold)
    plot.vertical(scale.factor * *f->second.threshold, Paint::faint(), "threshold");
  const double last = results.steps.back().step;
  plot.colour_bar({"step", first, last, ColourBar::Map::time});
  return plot;
}

Plot forecast_convergence_plot(const record::Results& results, const std::string& name) {
  const ForecastScale scale = forecast_scale(results, name);
  std::vector<double> x, mean, low, high, most, published_x, published_low, published_high;
  for (const auto& s : results.steps) {
    const auto found = s.forecast.find(name);
    if (found == s.forecast.end()) continue;
    const record::StepForecast& f = found->second;
    x.push_back(s.step);
    mean.push_back(scale.factor * f.mean);
    most.push_back(scale.factor * f.maximum_a_posteriori);
    const bool quantiles = !f.values.empty() && f.levels.front() < 0.03 && f.levels.back() > 0.97;
    low.push_back(scale.factor * (quantiles ? f.values.front() : f.mean - 1.96 * f.std));
    high.push_back(scale.factor * (quantiles ? f.values.back() : f.mean + 1.96 * f.std));
    if (f.published.empty() || !f.published_agrees) continue;
    published_x.push_back(x.back());
    published_low.push_back(scale.factor * f.published.front());
    published_high.push_back(scale.factor * f.published.back());
  }
  Plot plot(scale.quantity + " as the data come in", {"step"}, {scale.label()});
  plot.band(x, low, high, Paint::series(1), "95 % of the probability");
  plot.line(x, mean, Paint::series(1), "mean", {2.2});
  plot.line(x, most, Paint::ink(), "most probable", {1.3, "3 3", 1.0});
  if (!published_x.empty()) {
    plot.line(published_x, published_low, Paint::series(0), "95 %, Gaussian approximation (paper, Eq. 33)",
              {1.3, "5 3", 1.0});
    plot.line(published_x, published_high, Paint::series(0), "", {1.3, "5 3", 1.0});
  }
  if (const auto f = results.forecasts.find(name); f != results.forecasts.end() && f->second.threshold)
    plot.horizontal(scale.factor * *f->second.threshold, Paint::faint(), "threshold");
  return plot;
}

}  // namespace knothe::report
