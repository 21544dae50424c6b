#pragma once
/// @file Where a crack ends, from its opening along the path: a posterior on the position of the tip. Private
/// to the room.
#include <array>
#include <span>
#include <vector>

namespace knothe::imaging {

/// One opening, the mean over `width` px of the path about `along`.
struct OpeningDatum {
  double along = 0, width = 0;  ///< px, from the mouth
  double opening = 0, std = 0;  ///< px
};

struct TipPosterior {
  double log_evidence = 0;           ///< for a tip anywhere on the path against no crack, natural log
  double mean = 0, std = 0;          ///< px along the path
  std::array<double, 2> interval{};  ///< 2.5 % and 97.5 %
  double beyond = 0;                 ///< probability that the tip lies beyond the last datum
  double misfit = 0;  ///< χ² per degree of freedom at the best tip, before the errors were made larger by it
};

/// The opening at distance ξ from the tip is taken as Σ_k c_k ξ^(q+k), k = 0, 1, 2, with q = 1/2 (elastic
/// crack), 1 (a hinge, or damage) or 3/2 (cohesive forces that close it smoothly), all alike before; nothing
/// beyond the tip. The coefficients have a Gaussian prior as wide as twice the largest opening and are
/// integrated out; the tip has a uniform prior on the path and a fifth of it more. Data that no such curve
/// explains (four deviations) are left out, at most a fifth of them, and where χ² per degree of freedom
/// exceeds 1 the errors are enlarged by it. `data` in the order of the path, mouth first; at least 6, else
/// the evidence is 0.
[[nodiscard]] TipPosterior crack_tip(std::span<const OpeningDatum> data);

}  // namespace knothe::imaging
