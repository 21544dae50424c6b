#pragma once
/// @file Numbers for people.
#include <string>

namespace knothe::record {

/// A number for people: `significant` digits, no exponent between 1e-4 and 1e6, a true minus sign, "1.5·10⁻⁷"
/// beyond. Errors: NumericalError if not finite.
[[nodiscard]] std::string readable(double value, int significant = 3);

/// A number that was given, not measured: at most four digits, without trailing zeros ("0.3", "25").
[[nodiscard]] std::string plain(double value);

/// "1.04 ± 0.041": the standard deviation with two significant digits, the mean to the same decimal;
/// "(2.002 ± 0.017)·10¹¹" where that has more than three digits before the point.
[[nodiscard]] std::string with_uncertainty(double mean, double std);

/// A value to the decimals that a standard deviation makes worth reading: "1.04", "2.002·10¹¹".
[[nodiscard]] std::string to_decimals_of(double std, double value);

/// Superscript digits, e.g. "⁻³".
[[nodiscard]] std::string superscript(int value);

}  // namespace knothe::record
