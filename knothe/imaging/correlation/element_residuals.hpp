#pragma once
/// @file Residuals of one element, pixel by pixel. Private to the room.
#include <vector>

#include "knothe/imaging/correlation/residual_kernel.hpp"

namespace knothe::imaging {

/// f(x) − α g(x + u(x)) − β at those pixels of an element that count and are seen by the deformed picture.
[[nodiscard]] std::vector<float> element_residuals(const PixelTable& table, const ElementPixels& element,
                                                   const ReferenceRows& f, const SplineImage& g,
                                                   const ElementMotion& motion);

}  // namespace knothe::imaging
