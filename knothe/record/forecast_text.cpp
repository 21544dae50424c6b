#include "knothe/record/forecast_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "knothe/record/number_text.hpp"

namespace knothe::record {
namespace {

/// Whether a prefix may stand before the unit: its first symbol is one of these, to the power of one.
bool takes_prefix(const std::string& units) {
  const std::string symbol = units.substr(0, units.find_first_of(" /"));
  return symbol == "Pa" || symbol == "N" || symbol == "J" || symbol == "W" || symbol == "Hz" || symbol == "V";
}

/// "840": of a number that is not worth more.
std::string two_digits(double value) {
  return readable(std::strtod(fmt::format("{:.1e}", value).c_str(), nullptr), 2);
}

}  // namespace

std::pair<double, std::string> readable_unit(double size, const std::string& units) {
  if (units == "1" || units.empty()) return {1.0, ""};
  if (units == "m") return size < 1e-5 ? std::pair(1e6, " µm") : std::pair(1e3, " mm");
  if (size < 1e4 || !takes_prefix(units)) return {1.0, " " + units};
  if (size < 1e6) return {1e-3, " k" + units};
  return size < 1e9 ? std::pair(1e-6, " M" + units) : std::pair(1e-9, " G" + units);
}

Precision::Precision(const assimilation::Verdict& verdict)
    : is_rejected_(verdict.level == assimilation::VerdictLevel::reject), shift_(verdict.model_shift_std) {}

double Precision::of_parameter(double std, Index parameter) const {
  return parameter < shift_.size() ? std * std::hypot(1.0, shift_[parameter]) : std;
}

double Precision::of_forecast(double std) const {
  return shift_.size() > 0 ? std * std::hypot(1.0, shift_.maxCoeff()) : std;
}

std::string Precision::estimate(double mean, double std) const {
  return is_rejected_ ? two_digits(mean) : with_uncertainty(mean, std);
}

std::string Precision::number(double value, double std) const {
  return is_rejected_ ? two_digits(value) : to_decimals_of(std, value);
}

std::string value_text(double mean, double std, const std::string& units, const Precision& precision) {
  const auto [factor, unit] = readable_unit(std::max(std::abs(mean), std), units);
  return precision.estimate(factor * mean, factor * std) + unit;
}

std::string given_text(double value, const std::string& units) {
  const auto [factor, unit] = readable_unit(std::abs(value), units);
  return plain(factor * value) + unit;
}

std::string probability_text(double probability) {
  if (probability < 0.001) return "< 0.1 %";
  if (probability > 0.999) return "> 99.9 %";
  return fmt::format("{:.3g} %", 100 * probability);
}

std::string horizon_text(double horizon, const model::Loading& loading) {
  if (const auto imposed = loading.at(horizon)) return given_text(*imposed, loading.units);
  return "time " + given_text(horizon, loading.time_units);
}

std::string forecast_text(const assimilation::NamedForecast& named, const model::Loading& loading,
                          const Precision& precision) {
  const assimilation::ScalarForecast& f = named.forecast;
  const double std = precision.of_forecast(f.std);
  const auto [factor, unit] = readable_unit(std::max(std::abs(f.mean), f.std), named.units);
  const auto number = [&, factor = factor](double value) {
    return to_decimals_of(factor * std, factor * value);
  };
  const double above = f.probability_above_threshold;
  std::string text = fmt::format("{} at {}{}: {}", named.name, horizon_text(named.horizon, loading),
                                 named.is_past ? " (past: an estimate, not a forecast)" : "",
                                 value_text(f.mean, std, named.units, precision));
  if (precision.is_rejected()) return text + " (do not use)";
  text += fmt::format(", most probable {}, 95 % in [{}, {}]", number(f.maximum_a_posteriori),
                      number(f.values.front()), number(f.values.back()));
  if (named.threshold_stated)
    text += fmt::format("; threshold {}{}: P(above) {}, P(below) {}", plain(factor * named.threshold), unit,
                        probability_text(above), probability_text(1 - above));
  return text;
}

std::string action_text(const assimilation::Decision& decision) {
  if (decision.action != assimilation::Action::load) return std::string(to_text(decision.action));
  return "load to " + (decision.load ? given_text(*decision.load, decision.load_units)
                                     : "time " + given_text(decision.time, decision.time_units));
}

}  // namespace knothe::record
