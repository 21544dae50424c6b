#pragma once
/// @file Do the data push a parameter against an end of the model's range?
#include <Eigen/Core>

#include "knothe/posterior/posterior.hpp"

namespace knothe::assimilation {

/// How steeply a marginal density falls from an edge: of the four fifths of its mass next to the edge, the
/// share in the nearer half of the way. A density that only falls, exp(−x): 0.69; a normal one whose mean is
/// two, one, no standard deviations beyond the edge: 0.67, 0.65, 0.60; a flat one 0.5, one far inside next to
/// 0. A mode near the edge and another far away would have much too, but not the half of the mass next to the
/// edge.
[[nodiscard]] double edge_pressure(const posterior::Posterior& posterior, Eigen::Index a, double edge);

/// Of truths evenly spread over the box, the share whose data would press a normal posterior as much or more
/// against an edge of it. `width`: the posterior's standard deviation over that of the box. The narrower, the
/// rarer: few truths are that near to an edge.
[[nodiscard]] double probability_inside(double pressure, double width);

}  // namespace knothe::assimilation
