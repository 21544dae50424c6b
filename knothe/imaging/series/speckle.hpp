#pragma once
/// @file Synthetic speckle pictures of a surface whose displacement is known exactly.
///
/// The pattern is a sum of smooth dots in the material frame, F(X) = level + Σ_k amplitude_k exp(−|X −
/// X_k|²/2s_k²). A deformed picture shows at pixel x the material point X with X + u(X) = x, found by
/// Newton's method, hence no interpolation error at all. What a camera adds: blur by integration over the
/// pixel, gain and offset, noise, dead pixels, quantisation and saturation.
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "knothe/files/picture.hpp"

namespace knothe::imaging {

/// Displacement (px, x to the right, y down) of material point (X, Y) (px), and its gradient du/dX, du/dY,
/// dv/dX, dv/dY.
struct Displacement {
  double u = 0, v = 0;
  std::array<double, 4> gradient{};
};
using DisplacementField = std::function<Displacement(double x, double y)>;
/// How much of a material point is body (1) and how much background (0); smooth at the outline.
using BodyShape = std::function<double(double x, double y)>;

/// Light of what is not body.
inline constexpr double k_background = 0.06;

struct SpeckleOptions {
  int width = 512, height = 512;  ///< px
  double dot_radius = 2.0;        ///< mean of s_k, px; the speckle's size is about 2.4 times that
  double coverage = 2.5;          ///< mean number of dots (of area 2πs²) over a point
  double margin = 60;             ///< dots reach that far beyond the picture, px
  std::uint64_t seed = 1;
};

struct SpeckleCamera {
  int bit_depth = 8;
  double noise = 0;             ///< standard deviation, grey levels of an 8-bit camera scaled to the depth
  double gain = 1, offset = 0;  ///< brightness and contrast; offset in 8-bit levels
  int supersampling = 1;        ///< n × n points a pixel: what integration over the pixel blurs
  double dead_pixels = 0;       ///< share of pixels that stay black
  bool quantise = true;
  std::uint64_t seed = 1;  ///< of noise and dead pixels
};

/// The grey level that a camera makes of the light 0 … 1 in pixel `counter` of a picture.
[[nodiscard]] float recorded_level(const SpeckleCamera& camera, double light, std::uint64_t counter);

/// A fixed pattern of dots, drawn under any displacement.
class SpecklePattern {
 public:
  /// Errors: UsageError for sizes that make no sense.
  explicit SpecklePattern(SpeckleOptions options = {});
  [[nodiscard]] const SpeckleOptions& options() const { return options_; }
  /// Grey level 0 … 1 of a material point.
  [[nodiscard]] double at(double x, double y) const;
  /// The same of what is body and what background.
  [[nodiscard]] double at(double x, double y, const BodyShape& body) const;
  /// The picture under a displacement field (empty: none). Where x = X + u(X) has no solution nearby (a
  /// crack's opening) the pixel is black. `body` (empty: everywhere): beside it there is a dark background.
  /// Errors: UsageError for a field that is not finite.
  [[nodiscard]] files::Picture render(const DisplacementField& displacement = {},
                                      const SpeckleCamera& camera = {}, int threads = 1,
                                      const BodyShape& body = {}) const;

 private:
  struct Dot {
    float x, y, inverse_two_variance, amplitude;
  };
  SpeckleOptions options_;
  double cell_ = 8;  ///< px: dots are found through a grid of cells
  int columns_ = 0, rows_ = 0;
  std::vector<std::vector<Dot>> cells_;  ///< all dots that reach into a cell
};

}  // namespace knothe::imaging
