#pragma once
/// @file From the equivalent elastic crack to the crack that is meant, e.g. that of the damage field.
#include <array>
#include <vector>

#include "knothe/assimilation/forecast/scalar_forecast.hpp"

namespace knothe::assimilation {

/// Length of the crack that is meant against that of the equivalent elastic crack: linear between points,
/// moved by as much as the nearest point beyond them. Without points it is the elastic crack itself.
class LengthCurve {
 public:
  using Points = std::vector<std::array<double, 2>>;  ///< [elastic, meant], m

  LengthCurve() = default;
  /// Errors: ProjectError unless both lengths are finite and increase from point to point.
  explicit LengthCurve(Points points);

  [[nodiscard]] bool is_identity() const { return points_.empty(); }
  [[nodiscard]] double operator()(double elastic) const;
  [[nodiscard]] double inverse(double meant) const;
  /// The forecast of the meant length, of one of the elastic length: quantiles and density carried over,
  /// and by what the curve changes mean and standard deviation at the density's points.
  [[nodiscard]] ScalarForecast operator()(ScalarForecast elastic) const;

 private:
  Points points_;
};

}  // namespace knothe::assimilation
