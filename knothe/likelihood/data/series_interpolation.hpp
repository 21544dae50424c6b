#pragma once
/// @file A series at the times of other data: a load cell at the times of the pictures.
#include <span>

#include "knothe/likelihood/data/measurements.hpp"

namespace knothe::likelihood {

/// `series`, measured at the times `from` (increasing), at the times `to`: linear between the values on
/// either side, with their rate of change. NaN (missing) before the first value, behind the last, and beside
/// a missing one; times that agree to 1e-9 of the range are equal. The standard deviations stay as they are:
/// that of a mean of two values is less.
[[nodiscard]] MeasuredSeries interpolate_series(const MeasuredSeries& series, std::span<const double> from,
                                                std::span<const double> to);

}  // namespace knothe::likelihood
