#pragma once
/// @file One value ahead of a short series: how the time modes of a model's bias go on.
#include <span>

namespace knothe::likelihood {

/// The value of a series at `time`, from its values `series` at `times` (strictly increasing, as many, at
/// least one; `time` after the last): that of the polynomial of degree min(`order`, values − 1) through the
/// last max(`window`, order + 1) values, by least squares (Rubio et al. 2019, §4.2: a line through two).
[[nodiscard]] double extrapolate(int order, int window, std::span<const double> times,
                                 std::span<const double> series, double time);

}  // namespace knothe::likelihood
