#pragma once
/// @file What a full-order run depends on, as text: how a kept run is told from another one.
#include <string>

#include "knothe/mechanics/full_order/offline.hpp"

namespace knothe::mechanics {

/// Everything the result of a run depends on. Numbers of processes, names of axes and references are not in
/// it: what counts is the physical value.
[[nodiscard]] std::string run_key(const BeamProblem& problem);

}  // namespace knothe::mechanics
