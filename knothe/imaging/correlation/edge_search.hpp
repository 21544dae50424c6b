#pragma once
/// @file The edge of a body along a short straight strip of a picture, to a fraction of a pixel. Private to
/// the room.
#include <optional>

#include "knothe/files/picture.hpp"

namespace knothe::imaging {

/// Bilinear interpolation; the point must lie in the picture.
[[nodiscard]] double sampled(const files::Picture& picture, double x, double y);

/// A strip across an expected edge, px; (nx, ny) points out of the body and has length 1.
struct EdgeStrip {
  double x = 0, y = 0, nx = 0, ny = 0;
  double length = 0;               ///< along the edge
  double inside = 0, outside = 0;  ///< how far to look
};

struct EdgeFound {
  double offset = 0;  ///< px, outwards from the strip's middle
  double std = 0;     ///< px
};

/// Nothing where the strip shows no edge. `fine`: to a fraction of a pixel.
[[nodiscard]] std::optional<EdgeFound> find_edge(const files::Picture& picture, const EdgeStrip& strip,
                                                 bool fine);

}  // namespace knothe::imaging
