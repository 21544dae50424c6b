/// @file What a project file needs of `ScalarObservation`, without the model.
#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/model/observe/scalar_observations.hpp"

namespace knothe::model {

ScalarObservation ScalarObservation::elongation(const std::string& name, std::span<const double, 3> from,
                                                std::span<const double, 3> to, bool strain) {
  const double length = std::hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]);
  if (!(length > 0)) {
    throw UsageError(fmt::format("sensor \"{}\" is between a point and itself: give two points", name));
  }
  ScalarObservation sensor;
  sensor.name = name;
  sensor.units = strain ? "1" : "m";
  for (std::size_t c = 0; c < 3; ++c) {
    const double direction = (to[c] - from[c]) / length / (strain ? length : 1);
    if (direction == 0) continue;
    for (const auto& [point, sign] : {std::pair(to, 1.0), std::pair(from, -1.0)}) {
      sensor.points.insert(sensor.points.end(), point.begin(), point.end());
      sensor.components.push_back(c);
      sensor.coefficients.push_back(sign * direction);
    }
  }
  return sensor;
}

ScalarObservation ScalarObservation::strain_in_window(const std::string& name, std::span<const double, 3> at,
                                                      double window, std::array<int, 2> axes) {
  if (!(window > 0)) throw UsageError(fmt::format("sensor \"{}\": its window has no width", name));
  constexpr int k_side = 9;  // points
  const int a = axes[0], b = axes[1];
  const std::array<int, 2> plane = a != b ? axes : std::array{0, a == 2 ? 2 : 1};
  const auto offset = [&](int i) { return ((i + 0.5) / k_side - 0.5) * window; };
  double squares = 0;  // of the offsets along an axis
  for (int i = 0; i < k_side; ++i) squares += k_side * offset(i) * offset(i);
  ScalarObservation sensor;
  sensor.name = name;
  sensor.units = "1";
  for (int i = 0; i < k_side; ++i) {
    for (int j = 0; j < k_side; ++j) {
      const std::array<double, 2> moved = {offset(i), offset(j)};
      const auto add = [&](int component, int along) {
        std::array<double, 3> point = {at[0], at[1], at[2]};
        for (int k = 0; k < 2; ++k) point[plane[k]] += moved[k];
        sensor.points.insert(sensor.points.end(), point.begin(), point.end());
        sensor.components.push_back(component);
        sensor.coefficients.push_back(moved[along == plane[0] ? 0 : 1] / squares / (a == b ? 1 : 2));
      };
      add(a, b);
      if (a != b) add(b, a);
    }
  }
  return sensor;
}

}  // namespace knothe::model
