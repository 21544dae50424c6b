#include "knothe/report/data/words.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cctype>

#include "knothe/record/forecast_text.hpp"
#include "knothe/record/number_text.hpp"

namespace knothe::report {
namespace {

std::string with_capital(std::string text) {
  if (!text.empty() && text[0] >= 'a' && text[0] <= 'z') text[0] = text[0] - 'a' + 'A';
  std::replace(text.begin(), text.end(), '_', ' ');
  return text;
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

std::string parameter_label(const record::ParameterSummary& parameter) {
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

ForecastScale forecast_scale(const record::Results& results, const std::string& name) {
  const auto found = results.forecasts.find(name);
  record::ForecastSummary summary =
      found == results.forecasts.end() ? record::ForecastSummary{} : found->second;
  if (const auto last = results.steps.back().forecast.find(name);
      summary.unit.empty() && last != results.steps.back().forecast.end())
    summary.unit = last->second.units;
  ForecastScale scale;
  scale.crack = summary.quantity == "crack_length" || (summary.quantity.empty() && name.find("crack") == 0);
  scale.title = scale.crack ? "Equivalent elastic crack length" : with_capital(name);
  if (summary.horizon)
    scale.title += " at " + record::horizon_text(
                                *summary.horizon,
                                {"", "m", results.curve_time, results.displacement, results.time_units});
  else if (scale.crack && name != "crack")
    scale.title += " (" + name + ")";
  const UnitScale shown = unit_scale(scale.crack ? "m" : summary.unit);
  scale.unit = shown.unit, scale.factor = shown.factor;
  return scale;
}

}  // namespace knothe::report
