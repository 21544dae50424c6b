#pragma once
/// @file How values that belong to no noise are treated.

namespace knothe::likelihood {

struct RobustOptions {
  /// Values whose test ratio is larger are rejected; 0: none. Not where more than half of the sensors would
  /// be: then it is the model that is wrong, or the load, not the sensors.
  double gate = 0;
  /// The noise of each sensor is Student-t with this many degrees of freedom; 0: Gaussian. Independent noise
  /// only.
  double degrees_of_freedom = 0;
  [[nodiscard]] bool is_active() const { return gate > 0 || degrees_of_freedom > 0; }
};

}  // namespace knothe::likelihood
