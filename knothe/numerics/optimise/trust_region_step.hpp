#pragma once
/// @file Whether a step of a trust-region method is taken, and how the radius follows. Private to the room.
#include <algorithm>
#include <cmath>

namespace knothe::numerics {

/// A step that the minimiser has tried.
struct TrialStep {
  bool feasible;     ///< the objective took the point, and its value is finite
  double predicted;  ///< decrease by the quadratic model
  double value, trial_value;
  double gradient_norm, trial_gradient_norm;
  double length;

  /// Actual over predicted decrease; −1 for a point that is refused.
  [[nodiscard]] double agreement() const {
    if (!feasible) return -1;
    // Below rounding of the value itself the ratio says nothing; then trust the gradient.
    const double noise = 1e-14 * (1 + std::abs(value));
    if (std::abs(predicted) < noise && trial_value <= value + noise)
      return trial_gradient_norm <= gradient_norm ? 1 : -1;
    return (value - trial_value) / predicted;
  }
};

/// A step of this agreement is taken.
inline constexpr double k_least_agreement = 1e-4;

/// The radius after a step: wider where the model held to the border, narrower where it did not hold.
[[nodiscard]] inline double next_radius(double radius, double most, double agreement, double length) {
  if (!(agreement > k_least_agreement)) return 0.25 * std::min(length, radius);
  if (agreement < 0.25) return 0.5 * length;
  return agreement > 0.75 && length > 0.8 * radius ? std::min(2.5 * radius, most) : radius;
}

}  // namespace knothe::numerics
