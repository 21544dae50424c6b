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

/// Decimals of value / 10^exponent.
struct Rounding {
  int decimals, exponent;
};

/// After rounding: 9.999 with three digits is 10.0.
int exponent_of(double value, int significant) {
  const std::string scientific = fmt::format("{:.{}e}", value, significant - 1);
  return std::atoi(scientific.c_str() + scientific.find('e') + 1);
}

Rounding rounding_of(double mean, double std) {
  require_finite(mean, "a mean");
  require_finite(std, "a standard deviation");
  const int of_std = exponent_of(std, 2);
  const int exponent = of_std < 3 ? 0 : exponent_of(std::max(std::abs(mean), std), 2);
  return {std::clamp(1 - of_std + exponent, 0, 12), exponent};
}

std::string fixed(double value, const Rounding& r) {
  return with_minus(fmt::format("{:.{}f}", value / std::pow(10.0, r.exponent), r.decimals));
}

}  // namespace

std::string superscript(int value) {
  static constexpr const char* digits[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string out = value < 0 ? "⁻" : "";
  for (char c : std::to_string(std::abs(value))) out += digits[c - '0'];
  return out;
}

std::string readable(double value, int significant) {
  require_finite(value, "a number");
  if (value == 0.0) return "0";
  const int exponent = exponent_of(value, significant);
  if (exponent < -4 || exponent >= 6)
    return with_minus(fmt::format("{:.{}f}", value / std::pow(10.0, exponent), significant - 1)) + "·10" +
           superscript(exponent);
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
  const Rounding r = rounding_of(mean, std);
  if (!(std > 0.0)) return readable(mean, 4) + " ± 0";
  const std::string text = fixed(mean, r) + " ± " + fixed(std, r);
  return r.exponent == 0 ? text : "(" + text + ")·10" + superscript(r.exponent);
}

std::string to_decimals_of(double std, double value) {
  const Rounding r = rounding_of(value, std);
  if (!(std > 0.0)) return readable(value, 4);
  return fixed(value, r) + (r.exponent == 0 ? "" : "·10" + superscript(r.exponent));
}

}  // namespace knothe::record
