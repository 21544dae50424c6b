#pragma once
/// @file A series at the times of other data: a load cell at the times of the pictures.
#include <span>

#include "knothe/likelihood/data/measurements.hpp"

namespace knothe::likelihood {

/// `series`, measured at the times `from` (increasing), at the times `to`: linear between the values on
/// either side, with their rate of change: the slope of the line that fits best those within `window` of the
/// time, and those on either side. (From neighbours alone a rate of noisy values is noise.) NaN (missing)
/// before the first value, behind the last, and beside a missing one; times that agree to 1e-9 of the range
/// are equal. The standard deviations stay as they are: that of a mean of two values is less.
[[nodiscard]] MeasuredSeries interpolate_series(const MeasuredSeries& series, std::span<const double> from,
                                                std::span<const double> to, double window = 0);

/// `measured` at the times `to`: displacements where the times agree (to 1e-6 of a step), missing at others;
/// series as by `interpolate_series`. Errors: DataError for an error of all data whose effect is known at
/// their own times alone.
[[nodiscard]] Measurements at_times(Measurements measured, std::span<const double> to);

}  // namespace knothe::likelihood
