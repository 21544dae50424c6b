#pragma once
/// @file Text, numbers and ticks of figures and pages.
#include <string>
#include <vector>

namespace knothe::record {

/// A coordinate in pixels with two decimals at most ("12.5", "-3", "0"). Errors: NumericalError if not
/// finite.
[[nodiscard]] std::string coordinate(double value);

/// A number for people: `significant` digits, no exponent between 1e-4 and 1e6, a true minus sign, "1.5·10⁻⁷"
/// beyond. Errors: NumericalError if not finite.
[[nodiscard]] std::string readable(double value, int significant = 3);

/// A number that was given, not measured: at most four digits, without trailing zeros ("0.3", "25").
[[nodiscard]] std::string plain(double value);

/// "1.04 ± 0.041": the standard deviation with two significant digits, the mean to the same decimal.
[[nodiscard]] std::string with_uncertainty(double mean, double std);

/// Superscript digits, e.g. "⁻³".
[[nodiscard]] std::string superscript(int value);

struct Ticks {
  std::vector<double> values;
  std::vector<std::string> labels;
};

/// Multiples of 1, 2 or 5 times a power of ten inside [low, high]; about `wanted` of them, at least two
/// unless the range is empty; labels share their number of decimals. Errors: NumericalError for a range that
/// is not finite or low > high.
[[nodiscard]] Ticks nice_ticks(double low, double high, int wanted = 5);

/// Whole powers of ten inside [low, high], both positive, thinned to about `wanted`; `nice_ticks` where there
/// are fewer than two.
[[nodiscard]] Ticks decade_ticks(double low, double high, int wanted = 5);

}  // namespace knothe::record
