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

}  // namespace knothe::record
