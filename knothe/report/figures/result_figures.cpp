#include "knothe/report/figures/result_figures.hpp"

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cctype>
#include <cmath>

#include "knothe/record/number_text.hpp"

namespace knothe::report {
namespace {

double fraction(const record::Results& results, std::size_t i) {
  const double first = results.steps.front().step, last = results.steps.back().step;
  return last > first ? ((results.steps[i].step) - first) / (last - first) : 1.0;
}

ColourBar step_bar(const record::Results& results) {
  const double first = results.steps.front().step, last = results.steps.back().step;
  return {"step", first, last, ColourBar::Map::time};
}

/// log det of a covariance; of its diagonal where it is not positive definite.
double log_determinant(const record::Step& s) {
  const Eigen::LLT<Eigen::MatrixXd> factor(s.covariance);
  double sum = 0.0;
  for (Eigen::Index i = 0; i < s.mean.size(); ++i) {
    const double diagonal =
        factor.info() == Eigen::Success ? factor.matrixLLT()(i, i) : std::sqrt(s.covariance(i, i));
    sum += 2.0 * std::log(std::max(diagonal, 1e-150));
  }
  return sum;
}

/// Index on the load–displacement curve of step i: by time if the curve says its times, else by number.
std::size_t place_on_curve(const record::Results& results, std::size_t i) {
  const auto& time = results.curve_time;
  if (time.empty()) return results.displacement.size() == results.steps.size() ? i : results.steps[i].step;
  const auto after = std::lower_bound(time.begin(), time.end(), results.steps[i].time);
  if (after == time.begin()) return 0;
  const auto before = after - 1;
  const bool nearer = after == time.end() || results.steps[i].time - *before < *after - results.steps[i].time;
  return (nearer ? before : after) - time.begin();
}

/// Adds the steps that are not trusted, at their ordinate.
void mark_untrusted(Plot& plot, const record::Results& results, const std::vector<double>& y) {
  std::vector<double> x, at;
  for (std::size_t i = 0; i < results.steps.size(); ++i)
    if (!results.steps[i].trusted) x.push_back(results.steps[i].step), at.push_back(y[i]);
  if (!x.empty()) plot.scatter(x, at, Paint::truth(), "not trusted", 3.5);
}

}  // namespace

std::string pretty_name(const std::string& name) {
  if (name == "Y0") return "Y₀";
  if (name == "Ad") return "A_d";
  return name;
}

std::string pretty_units(const std::string& units) {
  std::string text;
  for (std::size_t i = 0; i < units.size(); ++i) {
    const bool is_power = i > 0 && std::isalpha(static_cast<unsigned char>(units[i - 1])) != 0;
    if (is_power && (units[i] == '2' || units[i] == '3'))
      text += units[i] == '2' ? "²" : "³";
    else
      text += units[i];
  }
  return text == "1" ? "" : text;
}

std::string axis_label(const record::ParameterSummary& parameter) {
  const std::string units = pretty_units(parameter.units);
  std::string meaning = units;
  if (parameter.reference && *parameter.reference != 1)
    meaning = fmt::format("1 = {}{}{}", record::plain(*parameter.reference), units.empty() ? "" : " ", units);
  return pretty_name(parameter.name) + (meaning.empty() ? "" : fmt::format(" ({})", meaning));
}

UnitScale unit_scale(const std::string& units) {
  if (units == "m") return {"mm", 1e3};
  if (units == "N") return {"kN", 1e-3};
  return {pretty_units(units)};
}

std::vector<std::size_t> learning_steps(const record::Results& results, std::size_t d, std::size_t count) {
  std::vector<std::size_t> order;
  std::vector<double> fall(results.steps.size(), 0.0);
  for (std::size_t i = 1; i < results.steps.size(); ++i) {
    const double before = results.steps[i - 1].standard_deviations()[d],
                 after = results.steps[i].standard_deviations()[d];
    if (before > 0.0 && after > 0.0) fall[i] = std::log(before / after);
    if (fall[i] > 0.02) order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return fall[a] > fall[b]; });
  order.resize(std::min(order.size(), count));
  std::sort(order.begin(), order.end());
  return order;
}

PlotAxis density_axis(const std::string& unit, const std::vector<double>& peaks) {
  const double low = peaks.empty() ? 0 : std::ranges::min(peaks),
               high = peaks.empty() ? 0 : std::ranges::max(peaks);
  const bool logarithmic = low > 0 && high > 20 * low;
  return {fmt::format("probability density{}{}", unit.empty() ? "" : fmt::format(" ({})", unit),
                      logarithmic ? ", logarithmic" : ""),
          logarithmic ? 1e-2 * low : 0.0,
          {},
          logarithmic};
}

std::vector<double> density_values(const std::vector<double>& values, const PlotAxis& axis) {
  std::vector<double> shown(values);
  if (axis.logarithmic)
    for (double& v : shown) v = std::max(v, 0.1 * *axis.low);
  return shown;
}

Plot marginals_plot(const record::Results& results, std::size_t d) {
  const record::ParameterSummary& parameter = results.parameters[d];
  PlotAxis x{axis_label(parameter)};
  x.low = parameter.lower;
  x.high = parameter.upper;
  std::vector<double> peaks;
  for (const record::Step& s : results.steps)
    if (const auto found = s.marginals.find(parameter.name);
        found != s.marginals.end() && !found->second.empty())
      peaks.push_back(std::ranges::max(found->second.values));
  const PlotAxis y = density_axis("", peaks);
  Plot plot("Posterior of " + pretty_name(parameter.name), x, y);
  if (const auto prior = results.prior_marginals.find(parameter.name); prior != results.prior_marginals.end())
    plot.line(prior->second.points, density_values(prior->second.values, y), Paint::ink(), "prior",
              {2.2, "2 3", 1.0});
  for (std::size_t i = 0; i < results.steps.size(); ++i) {
    const auto found = results.steps[i].marginals.find(parameter.name);
    if (found == results.steps[i].marginals.end()) continue;
    const bool last = i + 1 == results.steps.size();
    plot.line(found->second.points, density_values(found->second.values, y),
              Paint::time(fraction(results, i)), last ? "last step" : "", {last ? 2.8 : 1.2, {}, 1.0});
  }
  if (parameter.truth) plot.vertical(*parameter.truth, Paint::truth(), "true value");
  plot.colour_bar(step_bar(results));
  return plot;
}

Plot pair_plot(const record::Results& results, std::size_t row, std::size_t column) {
  const record::ParameterSummary &x = results.parameters[column], &y = results.parameters[row];
  Plot plot(pretty_name(y.name) + " against " + pretty_name(x.name) + ", last step", {axis_label(x)},
            {axis_label(y)});
  plot.scatter(results.draws[column], results.draws[row], Paint::series(0), "draws of the posterior", 1.8);
  if (x.truth && y.truth)
    plot.scatter(std::vector<double>{*x.truth}, std::vector<double>{*y.truth}, Paint::truth(), "true value",
                 4.5);
  return plot;
}

Plot convergence_plot(const record::Results& results, std::size_t d) {
  const record::ParameterSummary& parameter = results.parameters[d];
  Plot plot(pretty_name(parameter.name) + " as the data come in", {"step"}, {axis_label(parameter)});
  const auto x = results.step_numbers();
  const auto level = [&](double wanted, double sigmas) {
    return record::over_steps(results, [&](const record::Step& s) {
      for (std::size_t k = 0; k < s.levels.size(); ++k)
        if (std::abs(s.levels[k] - wanted) < 1e-9) return s.quantiles(d, k);
      return s.mean[d] + sigmas * s.standard_deviations()[d];
    });
  };
  plot.band(x, level(0.025, -1.96), level(0.975, 1.96), Paint::series(0), "95 % of the probability");
  plot.line(x, record::over_steps(results, [&](const record::Step& s) { return s.mean[d]; }),
            Paint::series(0), "mean", {2.2});
  if (parameter.truth) plot.horizontal(*parameter.truth, Paint::truth(), "true value");
  return plot;
}

Plot cost_plot(const record::Results& results) {
  const auto x = results.step_numbers();
  PlotAxis cost{"time of an update (µs)"};
  const auto update = record::over_steps(results, [](const record::Step& s) { return s.update_us; });
  const double low = *std::min_element(update.begin(), update.end());
  cost.logarithmic = low > 0.0 && *std::max_element(update.begin(), update.end()) > 8.0 * low;
  if (!results.has_maps()) {
    Plot plot("Time per step", {"step"}, cost);
    plot.line(x, update, Paint::series(1), "time of an update", {1.8});
    return plot;
  }
  Plot plot("Order of the map and time per step", {"step"}, {"order of the map", 0.0});
  plot.right_axis(cost);
  plot.bars(x, record::over_steps(results, [](const record::Step& s) -> double { return s.map_order; }), 0.8,
            Paint::series(5), "order of the map");
  plot.line(x, update, Paint::series(1), "time of an update", {1.8}, Side::right);
  return plot;
}

Plot load_plot(const record::Results& results) {
  std::vector<double> displacement, force;
  for (double u : results.displacement) displacement.push_back(1e3 * u);
  for (double f : results.force) force.push_back(1e-3 * f);
  Plot plot("Load and displacement", {"imposed displacement (mm)"}, {"force (kN)"});
  plot.line(displacement, force, Paint::ink(), "posterior mean prediction", {2.0});
  for (std::size_t d = 0; d < results.parameters.size(); ++d) {
    std::vector<double> x, y;
    for (std::size_t i : learning_steps(results, d)) {
      const std::size_t at = place_on_curve(results, i);
      if (at < displacement.size()) x.push_back(displacement[at]), y.push_back(force[at]);
    }
    if (!x.empty())
      plot.scatter(x, y, Paint::series(d),
                   pretty_name(results.parameters[d].name) + ": most informative steps",
                   d % 2 == 0 ? 5.5 : 3.5);
  }
  return plot;
}

Plot information_plot(const record::Results& results) {
  std::vector<double> x, gain;
  for (std::size_t i = 1; i < results.steps.size(); ++i) {
    x.push_back(results.steps[i].step);
    gain.push_back(0.5 * (log_determinant(results.steps[i - 1]) - log_determinant(results.steps[i])));
  }
  Plot plot("Information gained per step", {"step"}, {"entropy reduction (nats)"});
  if (!x.empty()) plot.bars(x, gain, 0.8, Paint::series(2), {}, Side::left, 0.8);
  return plot;
}

Plot variance_diagnostic_plot(const record::Results& results) {
  const auto x = results.step_numbers();
  // Below a millionth the map is exact for every purpose; a logarithmic axis must end somewhere.
  const auto y = record::over_steps(
      results, [](const record::Step& s) { return std::max(s.variance_diagnostic, 1e-6); });
  PlotAxis axis{"variance diagnostic (Eq. 9), at least 10⁻⁶"};
  axis.logarithmic = true;
  Plot plot("Accuracy of the map", {"step"}, axis);
  plot.line(x, y, Paint::series(0), "verified on points not used to train the map");
  plot.horizontal(0.05, Paint::faint(), "limit for “trusted”");
  mark_untrusted(plot, results, y);
  return plot;
}

Plot sample_size_plot(const record::Results& results) {
  const auto y =
      record::over_steps(results, [](const record::Step& s) { return 100.0 * s.effective_sample_size; });
  Plot plot("Effective sample size", {"step"}, {"of the samples (%)", std::nullopt, 102.0});
  plot.line(results.step_numbers(), y, Paint::series(2), "after importance correction");
  plot.horizontal(90.0, Paint::faint(), "limit for “trusted”");
  mark_untrusted(plot, results, y);
  return plot;
}

}  // namespace knothe::report
