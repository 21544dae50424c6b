#pragma once
/// @file Colours of maps: a perceptually even map for numbers (viridis) and one for what has a sign.
#include "knothe/report/figures/canvas.hpp"

namespace knothe::report {

/// The viridis map at `fraction`, clamped to [0, 1].
[[nodiscard]] Rgb viridis(double fraction);

/// A blue–white–red map at `fraction`; 0.5 is neutral. For fields with a sign.
[[nodiscard]] Rgb blue_white_red(double fraction);

}  // namespace knothe::report
