#pragma once
/// @file Where in a picture the surface is: the part that has a pattern.
#include <optional>

#include "knothe/files/picture.hpp"
#include "knothe/imaging/mesh/image_mesh.hpp"

namespace knothe::imaging {

/// The largest upright rectangle that is textured, px: where the standard deviation of the grey levels in
/// blocks of 16 px falls into two classes an order of magnitude apart (Otsu's threshold of its logarithm),
/// the blocks of the stronger. Small holes in it (a pore, a bare spot) belong to it; along edges of the
/// texture a block is left free, along edges of the picture `margin`. Empty where the picture has one class
/// only: it is the surface throughout.
[[nodiscard]] std::optional<Region> textured_region(const files::Picture& picture, double margin);

}  // namespace knothe::imaging
