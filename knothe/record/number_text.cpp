#include "knothe/record/number_text.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "knothe/base/error.hpp"

namespace knothe::record {
namespace {

void require_finite(double value, const char* what) {
  if (!std::isfinite(value)) throw NumericalError(fmt::format("figure: {} is not finite", what));
}

/// Typographic minus in front of a negative number, "0" for "-0".
std::string with_minus(std::string text) {
  if (text.empty() || text[0] != '-') return text;
  if (text.find_first_of("123456789") == std::string::npos) return text.substr(1);
  return "−" + text.substr(1);
}

}  // namespace

std::string coordinate(double value) {
  require_finite(value, "a coordinate");
  std::string text = fmt::format("{:.2f}", value);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text == "-0" ? "0" : text;
}

std::string superscript(int value) {
  static constexpr const char* digits[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string out = value < 0 ? "⁻" : "";
  for (char c : std::to_string(std::abs(value))) out += digits[c - '0'];
  return out;
}

std::string readable(double value, int significant) {
  require_finite(value, "a number");
  if (value == 0.0) return "0";
  // The exponent after rounding: 9.999 with three digits is 10.0.
  const std::string scientific = fmt::format("{:.{}e}", value, significant - 1);
  const auto e = scientific.find('e');
  const int exponent = std::atoi(scientific.c_str() + e + 1);
  if (exponent < -4 || exponent >= 6)
    return with_minus(scientific.substr(0, e)) + "·10" + superscript(exponent);
  return with_minus(fmt::format("{:.{}f}", value, std::max(0, significant - 1 - exponent)));
}

std::string plain(double value) {
  std::string text = readable(value, 4);
  if (text.find('.') == std::string::npos || text.find("·") != std::string::npos) return text;
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

std::string with_uncertainty(double mean, double std) {
  require_finite(mean, "a mean");
  require_finite(std, "a standard deviation");
  if (!(std > 0.0)) return readable(mean, 4) + " ± 0";
  const std::string scientific = fmt::format("{:.1e}", std);
  const int exponent = std::atoi(scientific.c_str() + scientific.find('e') + 1);
  const int decimals = std::clamp(1 - exponent, 0, 12);
  return with_minus(fmt::format("{:.{}f}", mean, decimals)) + " ± " + fmt::format("{:.{}f}", std, decimals);
}

Ticks nice_ticks(double low, double high, int wanted) {
  require_finite(low, "an axis limit");
  require_finite(high, "an axis limit");
  if (low > high) throw NumericalError("figure: an axis runs from a larger to a smaller number");
  Ticks ticks;
  if (low == high) {
    ticks.values = {low};
    ticks.labels = {readable(low)};
    return ticks;
  }
  // Of the steps 1, 2, 5 times a power of ten, the one whose number of ticks is nearest to what is wanted.
  const double rough = (high - low) / std::max(wanted, 1);
  const int power = std::floor(std::log10(rough));
  double step = 0.0;
  int step_power = power, best = 1 << 20;
  for (int p = power - 1; p <= power + 1; ++p)
    for (double digit : {1.0, 2.0, 5.0}) {
      const double candidate = digit * std::pow(10.0, p);
      const int count = std::floor(high / candidate + 1e-9) - std::ceil(low / candidate - 1e-9) + 1;
      const int distance = std::abs(count - wanted);
      if (count >= 2 && distance < best) best = distance, step = candidate, step_power = p;
    }
  const double first = std::ceil(low / step - 1e-9), last = std::floor(high / step + 1e-9);
  const double largest = std::max(std::abs(low), std::abs(high));
  const bool exponent_form = largest >= 1e6 || largest < 1e-4;
  for (double k = first; k <= last; k += 1.0) {
    const double value = k * step == 0.0 ? 0.0 : k * step;
    ticks.values.push_back(value);
    ticks.labels.push_back(exponent_form
                               ? readable(value, 2)
                               : with_minus(fmt::format("{:.{}f}", value, std::max(0, -step_power))));
  }
  return ticks;
}

Ticks decade_ticks(double low, double high, int wanted) {
  if (!(low > 0.0)) throw NumericalError("figure: a logarithmic axis needs positive numbers");
  const int first = std::ceil(std::log10(low) - 1e-9);
  const int last = std::floor(std::log10(high) + 1e-9);
  if (last - first < 1) return nice_ticks(low, high, wanted);
  Ticks ticks;
  const int stride = std::max(1, (last - first + wanted - 1) / std::max(wanted, 1));
  for (int p = first; p <= last; p += stride) {
    ticks.values.push_back(std::pow(10.0, p));
    ticks.labels.push_back(p >= 0 && p <= 4 ? fmt::format("{}", std::lround(std::pow(10.0, p)))
                                            : "10" + superscript(p));
  }
  return ticks;
}

}  // namespace knothe::record
