// What the assimilation found, in numbers: the tables on top of the page, and the comparison with the paper.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "knothe/numerics/statistics/order_statistics.hpp"
#include "knothe/record/forecast_text.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/data/words.hpp"
#include "knothe/report/pages/assimilation_report.hpp"

namespace knothe::report {
namespace {

std::string duration(double us) {
  if (us < 1e3) return record::readable(us, 2) + " µs";
  if (us < 1e6) return record::readable(1e-3 * us, 2) + " ms";
  return record::readable(1e-6 * us, 3) + " s";
}

std::string percent(double probability) {
  // Of samples: all of them above does not mean certainty.
  if (probability < 0.001) return "< 0.1 %";
  if (probability > 0.999) return "> 99.9 %";
  return "= " + record::readable(100.0 * probability, probability > 0.1 ? 3 : 2) + " %";
}

std::string with_unit(const std::string& number, const std::string& unit) {
  return unit.empty() ? number : number + " " + unit;
}

std::string interval(double low, double high, double std, const record::Precision& precision) {
  return precision.number(low, std) + " … " + precision.number(high, std);
}

/// Every number in the parameter's unit, where the model states one.
TableRow parameter_row(const record::Results& results, std::size_t d) {
  const record::ParameterSummary& p = results.parameters[d];
  const record::Step& last = results.steps.back();
  const record::Precision precision(results.verdict);
  const double relative_std = precision.of_parameter(last.standard_deviations()[d], d);
  const std::string units = pretty_units(p.units);
  const double reference = units.empty() ? 1 : p.reference.value_or(1);
  const auto [factor, unit] =
      record::readable_unit(std::abs(reference) * std::max(std::abs(last.mean[d]), relative_std), units);
  const double scale = factor * reference, std = std::abs(scale) * relative_std;
  const bool has_quantiles = last.quantiles.cols() > 1;
  const double low = has_quantiles ? last.quantiles(d, 0) : last.mean[d] - 1.96 * relative_std;
  const double high =
      has_quantiles ? last.quantiles(d, last.quantiles.cols() - 1) : last.mean[d] + 1.96 * relative_std;
  TableRow row{{units.empty() ? parameter_label(p) : pretty_name(p.name),
                precision.estimate(scale * last.mean[d], std) + unit,
                interval(scale * low, scale * high, std, precision) + unit}};
  if (p.truth) {
    const double distance = std > 0 ? std::abs(scale * (last.mean[d] - *p.truth)) / std : 0.0;
    const std::string far = distance > 100 ? "more than 100" : fmt::format("{:.1f}", distance);
    row.cells.push_back(fmt::format("{}{}, {} σ away", record::plain(scale * *p.truth), unit, far));
  } else {
    row.cells.push_back(precision.number(scale * last.maximum_a_posteriori[d], std) + unit);
  }
  return row;
}

TableRow forecast_row(const record::Results& results, const std::string& name) {
  const record::StepForecast& f = results.steps.back().forecast.at(name);
  const ForecastScale scale = forecast_scale(results, name);
  const record::Precision precision(results.verdict);
  const double std = precision.of_forecast(scale.factor * f.std);
  TableRow row{{scale.title, with_unit(precision.estimate(scale.factor * f.mean, std), scale.unit)}};
  row.expired = f.is_past;
  row.cells.push_back(f.values.empty() ? std::string()
                                       : with_unit(interval(scale.factor * f.values.front(),
                                                            scale.factor * f.values.back(), std, precision),
                                                   scale.unit));
  const auto summary = results.forecasts.find(name);
  std::string remark;
  if (summary != results.forecasts.end() && summary->second.threshold) {
    const std::string number = record::plain(scale.factor * *summary->second.threshold);
    const std::string threshold = scale.unit.empty() ? number : number + "\u00a0" + scale.unit;
    remark = fmt::format("P(>\u00a0{0})\u00a0{1}, P(<\u00a0{0})\u00a0{2}", threshold,
                         percent(f.probability_above_threshold), percent(1 - f.probability_above_threshold));
  }
  if (f.is_past) remark += (remark.empty() ? "" : "; ") + std::string("past: an estimate");
  row.cells.push_back(remark);
  return row;
}

}  // namespace

Usability usability(assimilation::VerdictLevel level) {
  using Level = assimilation::VerdictLevel;
  return level == Level::ok        ? Usability::usable
         : level == Level::caution ? Usability::with_caveats
                                   : Usability::not_usable;
}

std::string list_of(const std::vector<std::size_t>& numbers) {
  std::string out;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (i == 12) return out + fmt::format(" and {} more", numbers.size() - i);
    out += (i > 0 ? ", " : "") + std::to_string(numbers[i]);
  }
  return out;
}

std::string update_times(const record::Results& results, double record::Step::*time) {
  std::vector<double> times;
  for (const auto& s : results.steps) times.push_back(s.*time);
  return duration(numerics::quantile(times, 0.5)) + " (median), " +
         duration(numerics::quantile(times, 0.99)) + " (99 %)";
}

Usability worth_of(const record::Results& results) {
  return results.judged ? usability(results.verdict.level) : Usability::usable;
}

std::vector<Table> headline(const record::Results& results) {
  const Usability worth = worth_of(results);
  const bool has_truth = std::any_of(results.parameters.begin(), results.parameters.end(),
                                     [](const record::ParameterSummary& p) { return p.truth.has_value(); });
  Table parameters{"Parameters",
                   {"parameter", "estimate", "95 % between", has_truth ? "true value" : "most probable"},
                   {},
                   worth};
  for (std::size_t d = 0; d < results.parameters.size(); ++d)
    parameters.rows.push_back(parameter_row(results, d));
  std::vector<Table> tables = {std::move(parameters)};
  Table forecasts{"Forecasts", {"forecast", "value", "95 % between", "threshold"}, {}, worth};
  for (const auto& name : results.forecast_names()) forecasts.rows.push_back(forecast_row(results, name));
  std::stable_partition(forecasts.rows.begin(), forecasts.rows.end(),
                        [](const TableRow& row) { return !row.expired; });
  if (!forecasts.rows.empty()) tables.push_back(std::move(forecasts));
  return tables;
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

TableRow map_order_row(const record::Results& results) {
  const auto& steps = results.steps;
  const std::size_t highest = std::max_element(steps.begin(), steps.end(),
                                               [](const record::Step& a, const record::Step& b) {
                                                 return a.map_order < b.map_order;
                                               }) -
                              steps.begin();
  std::size_t first = highest, end = highest;
  const int floor = std::max(2, steps[highest].map_order - 1);
  for (std::size_t i = 0; i < steps.size(); ++i)
    if (steps[i].map_order >= floor) first = std::min(first, i), end = std::max(end, i);
  return {
      {"Map order", "1, and higher in steps 30–40 (changes at 32, 36, 38, 39)",
       fmt::format("up to {} (first reached at step {}); {} or more between steps {} and {}",
                   steps[highest].map_order, steps[highest].step, floor, steps[first].step, steps[end].step),
       "Here each map carries the whole posterior (all data in one quadratic form), not one step's "
       "change as in the paper's composition; and on this mesh the crack runs in steps 19–26."}};
}

std::vector<TableRow> comparison_with_paper(const record::Results& results) {
  const auto index = [&](const char* name) {
    for (int d = 0; d < std::ssize(results.parameters); ++d)
      if (results.parameters[d].name == name) return d;
    return -1;
  };
  const int y0 = index("Y0"), ad = index("Ad");
  if (results.parameters.size() != 2 || y0 < 0 || ad < 0) return {};
  if (worth_of(results) == Usability::not_usable) return {};
  const record::Step& last = results.steps.back();
  const record::Precision precision(results.verdict);
  const auto found = [&](int d) {
    return record::with_uncertainty(last.mean[d], precision.of_parameter(last.standard_deviations()[d], d));
  };
  std::vector<TableRow> rows;
  rows.push_back({{"Y₀ at the end", "1.04 ± 0.041", found(y0),
                   "Other noise, other sensors, another mesh. The paper's data come from its own reduced "
                   "model, so its posterior shows no error of the model; the sensors respond to Y₀ by under "
                   "1 µm, and only while the crack starts."}});
  rows.push_back(
      {{"A_d at the end", "1.00 ± 0.022", found(ad),
        "The sensors respond to A_d by up to 12 µm from the peak load on; the long tail of the test "
        "keeps narrowing it."}});
  for (const auto& name : results.forecast_names()) {
    const ForecastScale scale = forecast_scale(results, name);
    if (!scale.crack) continue;
    const record::StepForecast& f = last.forecast.at(name);
    rows.push_back({{scale.title, "37.2 mm (mean), 37.6 mm (most probable), at the final time",
                     fmt::format("{} mm, most probable {} mm",
                                 record::with_uncertainty(1e3 * f.mean, precision.of_forecast(1e3 * f.std)),
                                 record::readable(1e3 * f.maximum_a_posteriori, 3)),
                     "At the final 0.4 mm this mesh has lost 98 % of its stiffness, and an elastic crack of "
                     "equal compliance is 65–75 mm long; the paper's damage band is wider, its supports "
                     "softer, or both. An earlier horizon is where the length is uncertain."}});
  }
  if (results.has_maps()) rows.push_back(map_order_row(results));
  rows.push_back(
      {{"Time of a step, with forecasts", "less than 5 s", update_times(results, &record::Step::total_us),
        "All past data collapse into one small matrix; exact derivatives; compiled code."}});
  return rows;
}

}  // namespace knothe::report
