#pragma once
/// @file How far the two sides of a crack have moved apart. Private to the room.
#include <array>
#include <vector>

#include "knothe/imaging/crack/crack_path.hpp"

namespace knothe::imaging {

/// The motion of the side of larger t less that of the other, at the path, and its covariance (tt, ts, ss;
/// px²).
struct SideJump {
  double s = 0, t = 0;
  std::array<double, 2> jump{};
  std::array<double, 3> covariance{};
  bool measured = false;
};

/// In each of the path's bands: the pixels of either side from `gap` to `gap` + `reach` px are correlated by
/// themselves, with a motion that is linear across the crack, and extrapolated to the path. `variance`: of f
/// − α g, after any prefilter, as it counts in the normal equations (grey levels²).
[[nodiscard]] std::vector<SideJump> side_jumps(const CrackScene& scene, const RoughPath& path, double gap,
                                               double reach, double margin, double variance);

}  // namespace knothe::imaging
