#include "knothe/report/pages/fit_section.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "knothe/record/number_text.hpp"
#include "knothe/report/data/words.hpp"

namespace knothe::report {
namespace {

constexpr std::size_t k_max_signals = 8;

/// A step at which the alarm goes off: at the one before it was silent.
std::vector<std::size_t> alarms(const record::Results& results) {
  std::vector<std::size_t> at;
  for (std::size_t i = 0; i < results.steps.size(); ++i)
    if (results.steps[i].monitor.alarm && (i == 0 || !results.steps[i - 1].monitor.alarm))
      at.push_back(results.steps[i].step);
  return at;
}

std::string monitor_words(const record::Results& results) {
  if (const auto rang = alarms(results); !rang.empty())
    return fmt::format(
        "The alarm was raised at step {}: from some steps before on, the data differ from what the model "
        "predicted given all earlier data. A sensor that moved, a wrong noise level, a structure that "
        "changed and a wrong model all raise it.",
        fmt::join(rang, ", "));
  double nearest = 0;
  for (const record::Step& s : results.steps)
    if (s.monitor.threshold > 0) nearest = std::max(nearest, s.monitor.cumulative_sum / s.monitor.threshold);
  return fmt::format(
      "The alarm was not raised: each datum was compared with its prediction from the posterior before it, "
      "and the misfit statistic peaked at {:.0f} % of its alarm threshold.",
      100 * nearest);
}

void add_residuals(Page& page, const record::Results& results, const nlohmann::ordered_json& record) {
  std::vector<FigurePlace> figures;
  if (record.contains("residuals")) {
    figures.push_back({"residuals", "Standardised residuals"});
    figures.push_back({"quantiles", "Their quantiles beside those of a standard normal"});
  }
  const record::Residuals& r = results.residuals;
  if (!r.step.empty()) figures.push_back({"noise", "Size of the residuals beside the sensors' noise"});
  for (const char c : std::set<char>(r.component.begin(), r.component.end()))
    figures.push_back({fmt::format("residual_map:{}", c),
                       fmt::format("u_{}: mean residual of the last {} steps", c, r.averaged)});
  const std::size_t signals = record.contains("measured") ? record.at("measured").size() : 0;
  for (std::size_t k = 1; k < std::min(signals, k_max_signals); ++k)
    figures.push_back({fmt::format("measured:{}", k), "Measured, predicted: " + measured_title(record, k)});
  page.figures(figures,
               "Residual: measured minus predicted, in standard deviations of the prediction with its noise. "
               "If only noise is left, the dots have no trend, 95 % of them lie within ±2, their quantiles "
               "are on the line, and the maps show no pattern. (The motion of exported fields is taken out; "
               "that of pictures is contained.)");
  if (signals > k_max_signals) page.note(fmt::format("Only the first {} signals are drawn.", k_max_signals));
}

}  // namespace

std::string measured_title(const nlohmann::ordered_json& record, std::size_t k) {
  const auto& signal = record.at("measured").at(k);
  const auto name = signal.at("label").get<std::string>();
  const UnitScale scale = unit_scale(signal.at("units").get<std::string>());
  // A displacement says where it is; its unit is at the axis.
  return scale.unit.empty() || name.ends_with(" mm") ? name : fmt::format("{} ({})", name, scale.unit);
}

void add_fit(Page& page, const record::Results& results, const nlohmann::ordered_json& record) {
  page.section("Does the model fit the data?");
  add_residuals(page, results, record);
  if (!results.monitored) {
    page.note("These results hold no record of the evidence monitor.");
    return;
  }
  page.paragraph(monitor_words(results));
  std::vector<FigurePlace> figures = {{"evidence", "Evidence of each step"},
                                      {"monitor", "The monitor and its alarm"}};
  const bool joint = std::any_of(results.steps.begin(), results.steps.end(),
                                 [](const record::Step& s) { return s.monitor.discrepancy > 0; });
  if (joint) figures.push_back({"discrepancy", "Inferred size of the model discrepancy"});
  const auto& models = results.steps.back().models;
  if (!models.empty()) figures.push_back({"models", "Posterior probability of each model"});
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
  std::vector<TableRow> rows;
  for (const auto& [name, m] : models)
    rows.push_back({{name, record::readable(m.probability, 3), record::readable(m.log_evidence, 8),
                     record::readable(m.log_bayes_factor, 3)}});
  if (!rows.empty())
    page.table({"model", "probability", "log-evidence", "log Bayes factor of the best over it"}, rows);
}

}  // namespace knothe::report
