#pragma once
/// @file One value ahead of a short series: how the time modes of a model's bias go on.
#include <span>

namespace knothe::likelihood {

/// Ways of going on.
enum class Extrapolation {
  polynomial,        ///< least squares through the last values (Rubio et al. 2019, §4.2: a line through two)
  damped_trend,      ///< level and slope by exponential smoothing, the slope dying out
  gaussian_process,  ///< Matérn 3/2 around the mean, parameters by maximum likelihood
};

/// The value of a series at `time`, from its values `series` at `times` (strictly increasing, as many, at
/// least one; `time` after the last).
///
/// Polynomial: of degree min(`order`, values − 1) through the last max(`window`, order + 1) values. Damped
/// trend: Gardner and McKenzie, Management Science 31 (1985); of a few smoothing constants those that would
/// have predicted the series best. Gaussian process: the amplitude in closed form, length and noise on a grid
/// by the marginal likelihood (Rasmussen and Williams 2006, §5.4), the last 24 values.
[[nodiscard]] double extrapolate(Extrapolation kind, int order, int window, std::span<const double> times,
                                 std::span<const double> series, double time);

}  // namespace knothe::likelihood
