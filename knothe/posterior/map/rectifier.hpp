#pragma once
/// @file The positive functions r that make a map monotone, for one number.
#include <algorithm>
#include <cmath>

#include "knothe/posterior/map/parametrisation.hpp"

namespace knothe::posterior {

/// Beyond this h the exponential goes on as its tangent, so that no finite map overflows.
inline constexpr double k_exponential_limit = 300;
/// 1/log 2: makes the softplus of 0 equal to 1.
inline constexpr double k_softplus_scale = 1.4426950408889634074;
inline constexpr double k_log_softplus_scale = 0.36651292058166432701;

/// r(h) and its derivatives.
struct Rectified {
  double value, first, second;
};

[[nodiscard]] inline Rectified rectify(Rectifier rectifier, double h) {
  if (rectifier == Rectifier::square) return {h * h, 2 * h, 2};
  if (rectifier == Rectifier::softplus) {
    const double decay = std::exp(-std::abs(h)), larger = 1 / (1 + decay), smaller = decay * larger;
    return {k_softplus_scale * (std::max(h, 0.0) + std::log1p(decay)),
            k_softplus_scale * (h >= 0 ? larger : smaller), k_softplus_scale * larger * smaller};
  }
  const double inside = std::exp(std::min(h, k_exponential_limit)), over = h - k_exponential_limit;
  return over > 0 ? Rectified{inside * (1 + over), inside, 0} : Rectified{inside, inside, inside};
}

/// log r(h), without underflow; −∞ only for the square of 0.
[[nodiscard]] inline double log_rectified(Rectifier rectifier, double h) {
  switch (rectifier) {
    case Rectifier::square:
      return 2 * std::log(std::abs(h));
    case Rectifier::softplus:
      return h < -40 ? h + k_log_softplus_scale : std::log(rectify(rectifier, h).value);
    default:
      return h <= k_exponential_limit ? h : k_exponential_limit + std::log1p(h - k_exponential_limit);
  }
}

/// r'(h)/r(h), the derivative of log r; 0 where the square is singular.
[[nodiscard]] inline double log_rectified_slope(Rectifier rectifier, double h) {
  switch (rectifier) {
    case Rectifier::square:
      return h == 0 ? 0 : 2 / h;
    case Rectifier::softplus: {
      if (h < -40) return 1;
      const Rectified r = rectify(rectifier, h);
      return r.first / r.value;
    }
    default:
      return h <= k_exponential_limit ? 1 : 1 / (1 + h - k_exponential_limit);
  }
}

}  // namespace knothe::posterior
