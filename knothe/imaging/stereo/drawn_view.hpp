#pragma once
/// @file A speckled surface in space as a camera sees it: pairs of pictures whose shape and motion are known.
#include <Eigen/Core>
#include <functional>

#include "knothe/files/picture.hpp"
#include "knothe/imaging/camera/camera.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace knothe::imaging {

/// Where the material point (s, t) of a surface is, (s, t) in px of its pattern; smooth.
using SurfacePlace = std::function<Eigen::Vector3d(double s, double t)>;

/// The picture of `width` × `height` px that a camera takes of a surface with that pattern, 0 … 255, neither
/// rounded nor noisy. Each pixel is the mean of `supersampling`² points, at each of which the material point
/// is found by Newton's method: no interpolation. Errors: UsageError where a pixel does not see the surface.
[[nodiscard]] files::Picture drawn_view(const Camera& camera, int width, int height,
                                        const SpecklePattern& pattern, const SurfacePlace& surface,
                                        int supersampling = 1);

}  // namespace knothe::imaging
