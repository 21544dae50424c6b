#pragma once
/// @file A speckled surface in space as a camera sees it: pairs of pictures whose shape and motion are known.
#include <Eigen/Core>
#include <functional>

#include "knothe/files/picture.hpp"
#include "knothe/imaging/camera/camera.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace knothe::imaging {

/// Where the material point (s, t) of a surface is, (s, t) in px of its pattern; continuous.
using SurfacePlace = std::function<Eigen::Vector3d(double s, double t)>;

/// The picture of `width` × `height` px that a camera takes of a surface with that pattern. A pixel is the
/// mean of its points' light, at each of which the material point is found by Newton's method: no
/// interpolation. With `body` (empty: everywhere) there is a background, where that finds none too. Errors:
/// UsageError where a pixel sees neither.
[[nodiscard]] files::Picture drawn_view(const Camera& camera, int width, int height,
                                        const SpecklePattern& pattern, const SurfacePlace& surface,
                                        const SpeckleCamera& taken = {.quantise = false}, int threads = 1,
                                        const BodyShape& body = {});

}  // namespace knothe::imaging
