#pragma once
/// @file The sentences at the end: trusted or not, and why; and any doubt about the result itself.
#include <string>

#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::assimilation {

/// Of a map: that of `answer.trust`, with what the map's solve knows besides.
[[nodiscard]] std::string verdict(const posterior::MapResult& map,
                                  const posterior::ImportanceCorrection& answer,
                                  const posterior::PriorTransform& transform);

/// Doubts: where the observations do not fit at the most probable parameters; where this share of the
/// posterior is next to an end of a prior.
[[nodiscard]] std::string does_not_fit(double chi_squared, Eigen::Index count);
[[nodiscard]] std::string pressed(const std::string& parameter, double share, double end);

}  // namespace knothe::assimilation
