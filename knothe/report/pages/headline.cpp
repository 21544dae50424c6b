// What the assimilation found, in words: the cards on top of the page, and the comparison with the paper.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "knothe/numerics/statistics/order_statistics.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/figures/result_figures.hpp"
#include "knothe/report/pages/assimilation_report.hpp"

namespace knothe::report {
namespace {

std::string duration(double us) {
  if (us < 1e3) return record::readable(us, 2) + " µs";
  if (us < 1e6) return record::readable(1e-3 * us, 2) + " ms";
  return record::readable(1e-6 * us, 3) + " s";
}

std::vector<double> update_times(const record::Results& results) {
  std::vector<double> times;
  for (const auto& s : results.steps) times.push_back(s.update_us);
  return times;
}

std::string percent(double probability) {
  // Of samples: all of them above does not mean certainty.
  if (probability < 0.001) return "less than 0.1 %";
  if (probability > 0.999) return "more than 99.9 %";
  return record::readable(100.0 * probability, probability > 0.1 ? 3 : 2) + " %";
}

std::string list_of(const std::vector<std::size_t>& numbers) {
  std::string out;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (i == 12) return out + fmt::format(" and {} more", numbers.size() - i);
    out += (i > 0 ? ", " : "") + std::to_string(numbers[i]);
  }
  return out;
}

Card parameter_card(const record::Results& results, std::size_t d) {
  const record::ParameterSummary& p = results.parameters[d];
  const record::Step& last = results.steps.back();
  Card card{pretty_name(p.name), record::with_uncertainty(last.mean[d], last.standard_deviations()[d]), {}};
  const bool is_physical = !p.reference || *p.reference == 1;
  const std::string units = pretty_units(p.units);
  if (is_physical && !units.empty()) card.value += " " + units;
  if (p.truth) {
    const double distance = last.standard_deviations()[d] > 0.0
                                ? std::abs(last.mean[d] - *p.truth) / last.standard_deviations()[d]
                                : 0.0;
    card.remark = fmt::format("{:.1f} σ from the true value {}", distance, record::plain(*p.truth));
    card.warning = distance > 3.0;
  } else {
    card.remark = fmt::format("most probable: {}", record::readable(last.maximum_a_posteriori[d], 4));
  }
  if (!is_physical && !units.empty())
    card.remark =
        fmt::format("{} {}; {}",
                    record::with_uncertainty(*p.reference * last.mean[d],
                                             std::abs(*p.reference) * last.standard_deviations()[d]),
                    units, card.remark);
  return card;
}

Card forecast_card(const record::Results& results, const std::string& name) {
  const record::StepForecast& f = results.steps.back().forecast.at(name);
  const ForecastScale scale = forecast_scale(results, name);
  const auto summary = results.forecasts.find(name);
  Card card{scale.title,
            record::with_uncertainty(scale.factor * f.mean, scale.factor * f.std) +
                (scale.unit.empty() ? "" : " " + scale.unit),
            {}};
  const std::string unit = scale.unit.empty() ? "" : " " + scale.unit;
  if (summary != results.forecasts.end() && summary->second.threshold)
    card.remark =
        fmt::format("above {}{} with probability {}, below with {}",
                    record::plain(scale.factor * *summary->second.threshold), unit,
                    percent(f.probability_above_threshold), percent(1 - f.probability_above_threshold));
  else if (!f.values.empty())
    card.remark = fmt::format("95 % in [{}, {}]{}", record::plain(scale.factor * f.values.front()),
                              record::plain(scale.factor * f.values.back()), unit);
  if (f.is_past) card.remark += "; already past: an estimate, not a forecast";
  return card;
}

}  // namespace

std::vector<Card> headline(const record::Results& results) {
  std::vector<Card> cards;
  for (std::size_t d = 0; d < results.parameters.size(); ++d) cards.push_back(parameter_card(results, d));
  for (const auto& name : results.forecast_names()) cards.push_back(forecast_card(results, name));
  const auto untrusted = results.untrusted();
  const std::size_t n = results.steps.size();
  cards.push_back({"Is the computation reliable?",
                   untrusted.empty() ? fmt::format("all {} steps", n)
                                     : fmt::format("{} of {} steps", n - untrusted.size(), n),
                   !untrusted.empty() ? "not trusted: " + list_of(untrusted)
                   : results.has_maps()
                       ? "map verified on points not used to train it, samples cover the posterior"
                       : "verified without a map",
                   !untrusted.empty()});
  const auto times = update_times(results);
  cards.push_back(
      {"Time of an update", duration(numerics::quantile(times, 0.5)) + " (median)",
       fmt::format("without forecasts; 99 % below {}", duration(numerics::quantile(times, 0.99)))});
  return cards;
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
  const record::Step& last = results.steps.back();
  const auto found = [&](int d) {
    return record::with_uncertainty(last.mean[d], last.standard_deviations()[d]);
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
    rows.push_back(
        {{scale.title, "37.2 mm (mean), 37.6 mm (most probable), at the final time",
          fmt::format("{} mm, most probable {} mm", record::with_uncertainty(1e3 * f.mean, 1e3 * f.std),
                      record::readable(1e3 * f.maximum_a_posteriori, 3)),
          "At the final 0.4 mm this mesh has lost 98 % of its stiffness, and an elastic crack of "
          "equal compliance is 65–75 mm long; the paper's damage band is wider, its supports "
          "softer, or both. An earlier horizon is where the length is uncertain."}});
  }
  if (results.has_maps()) rows.push_back(map_order_row(results));
  rows.push_back({{"Time of a step, with forecasts", "less than 5 s",
                   [&] {
                     std::vector<double> total;
                     for (const auto& s : results.steps) total.push_back(s.total_us);
                     return duration(numerics::quantile(total, 0.5)) + " (median), " +
                            duration(numerics::quantile(total, 0.99)) + " (p99)";
                   }(),
                   "All past data collapse into one small matrix; exact derivatives; compiled code."}});
  return rows;
}

}  // namespace knothe::report
