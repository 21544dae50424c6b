#pragma once
/// @file The affine motion between two pictures of a surface, however large, from features that look alike
/// in both. Private to the room: ImageCorrelation starts from it where the search from coarse to fine
/// pictures fails.
///
/// Features are the blobs of the smoothed picture, extrema of the difference of two Gaussians; a speckle has
/// hundreds. How one looks is read on rings around it, beginning at the angle of their first harmonic, so
/// that it does not depend on the rotation; mean and contrast are taken out. Features that are each other's
/// best match are mostly right. The motion is the affine one, of three pairs, on which most pairs agree
/// (Fischler, Bolles 1981).
#include <optional>

#include "knothe/imaging/correlation/affine_motion.hpp"
#include "knothe/imaging/correlation/picture_pyramid.hpp"

namespace knothe::imaging {

/// Size of the region, px, in which features are looked for best: they take some pixels, and there is
/// neither a lack of them nor more than are needed.
inline constexpr double k_matched_size = 300;

/// Of the pixels of the reference that its mask (where it has one) sets. Nothing where too few features
/// agree. The same for any number of threads.
[[nodiscard]] std::optional<AffineMotion> matched_motion(const PyramidLevel& reference,
                                                         const files::Picture& deformed, int threads);

}  // namespace knothe::imaging
