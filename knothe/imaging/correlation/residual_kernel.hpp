#pragma once
/// @file The hot loop of image correlation: one element's residual f(x) − α g(x + u(x)) − β and what
/// Gauss–Newton needs of it, several pixels at a time.
#include <array>
#include <cmath>

#include "knothe/imaging/correlation/spline_image.hpp"
#include "knothe/imaging/mesh/image_mesh.hpp"

namespace knothe::imaging {

/// Some rows of the reference picture, `stride` floats each; the value of a pixel that does not count
/// (masked, saturated) is NaN.
struct ReferenceRows {
  const float *value, *dx, *dy;
  std::size_t stride;
  PixelRows rows;
  /// Of a pixel of the picture.
  [[nodiscard]] std::size_t index(int x, int y) const { return (y - rows.first) * stride + x; }
  [[nodiscard]] bool contains(int x, int y) const {
    return x >= 0 && static_cast<std::size_t>(x) < stride && y >= rows.first && y < rows.end;
  }
  [[nodiscard]] bool counts(std::size_t i) const { return !std::isnan(value[i]); }
};

/// Sums over the pixels of an element, r the residual in grey levels; monomials 1, X, Y, XY of ElementPixels.
struct ResidualSums {
  std::array<double, 4> x{}, y{};  ///< Σ r ∂f/∂x (1, X, Y, XY) and the same with ∂f/∂y
  double r = 0, r_squared = 0;     ///< Σ r, Σ r²
  double r_reference = 0;          ///< Σ r f
  double count = 0;                ///< pixels used: not masked, and seen by the deformed picture
};

/// u = Σ_m u_m (1, X, Y, XY)_m, v likewise, px. α `gain`, β `offset`.
struct ElementMotion {
  std::array<double, 4> u{}, v{};
  float gain = 1, offset = 0;
};

/// Whole vectors of pixels with the same integer part of the displacement read the spline coefficients
/// contiguously; where the integer part changes within a vector the vector is done once for each (Knothe
/// notes: 7 ms against 15 ms a megapixel with gathers). Quadrilaterals that are not upright read the natural
/// coordinates of their pixels besides, 8 B a pixel.
[[nodiscard]] ResidualSums residual_sums(const PixelTable& table, const ElementPixels& element,
                                         const ReferenceRows& f, const SplineImage& g,
                                         const ElementMotion& motion);

/// The residual itself at the pixels of an element, into a picture of rows of `stride` floats; NaN where
/// there is none.
void residual_pixels(const PixelTable& table, const ElementPixels& element, const ReferenceRows& f,
                     const SplineImage& g, const ElementMotion& motion, float* out, std::size_t stride);

}  // namespace knothe::imaging
