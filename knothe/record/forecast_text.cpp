#include "knothe/record/forecast_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "knothe/record/number_text.hpp"

namespace knothe::record {
namespace {

/// Factor and unit for a quantity of this size.
std::pair<double, std::string> readable_unit(double size, const std::string& units) {
  if (units == "1" || units.empty()) return {1.0, ""};
  if (units != "m") return {1.0, " " + units};
  return size < 1e-5 ? std::pair(1e6, std::string(" µm")) : std::pair(1e3, std::string(" mm"));
}

}  // namespace

std::string value_text(double mean, double std, const std::string& units) {
  const auto [factor, unit] = readable_unit(std::max(std::abs(mean), std), units);
  return with_uncertainty(factor * mean, factor * std) + unit;
}

std::string probability_text(double probability) {
  if (probability < 0.001) return "< 0.1 %";
  if (probability > 0.999) return "> 99.9 %";
  return fmt::format("{:.3g} %", 100 * probability);
}

std::string forecast_text(const assimilation::NamedForecast& named) {
  const assimilation::ScalarForecast& f = named.forecast;
  const auto [factor, unit] = readable_unit(std::max(std::abs(f.mean), f.std), named.units);
  // As many decimals as the standard deviation asks for.
  const double digit = f.std > 0 ? std::floor(std::log10(factor * f.std)) : -3;
  const int decimals = static_cast<int>(std::clamp(1 - digit, 0.0, 12.0));
  const auto number = [&, factor = factor](double value) {
    const std::string digits = fmt::format("{:.{}f}", factor * value, decimals);
    return digits[0] == '-' ? "−" + digits.substr(1) : digits;
  };
  const double above = f.probability_above_threshold;
  std::string text = fmt::format("{} at time {:g}{}: {}, most probable {}, 95 % in [{}, {}]", named.name,
                                 named.horizon, named.is_past ? " (past: an estimate, not a forecast)" : "",
                                 value_text(f.mean, f.std, named.units), number(f.maximum_a_posteriori),
                                 number(f.values.front()), number(f.values.back()));
  if (named.threshold_stated)
    text += fmt::format("; threshold {}{}: P(above) {}, P(below) {}", plain(factor * named.threshold), unit,
                        probability_text(above), probability_text(1 - above));
  return text;
}

}  // namespace knothe::record
