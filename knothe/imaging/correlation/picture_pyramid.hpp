#pragma once
/// @file Pictures of half, quarter … size, for finding large motions.
///
/// A pixel of level l is the mean of 2^l × 2^l pixels, so its centre X stands for x = 2^l X + (2^l − 1)/2:
/// forgetting the half pixel is the classical mistake.
#include <Eigen/Core>
#include <array>
#include <vector>

#include "knothe/files/picture.hpp"
#include "knothe/imaging/mesh/image_mesh.hpp"

namespace knothe::imaging {

struct PyramidLevel {
  files::Picture picture;
  files::Picture mask;  ///< 1 where all pixels below count; empty if there was none
};

/// Coordinate of the full picture in that of a level, and back.
[[nodiscard]] inline double to_level(double x, int level) {
  const double scale = 1 << level;
  return (x - 0.5 * (scale - 1)) / scale;
}
[[nodiscard]] inline double from_level(double x, int level) {
  const double scale = 1 << level;
  return scale * x + 0.5 * (scale - 1);
}

/// Levels 0 … top; level 0, the pictures themselves, is left empty where there are coarser ones.
[[nodiscard]] std::vector<PyramidLevel> picture_pyramid(const files::Picture& picture,
                                                        const files::Picture& mask, int top);

/// The shift in whole pixels (x, y) under which the deformed picture correlates best with the reference
/// (zero-normalised), up to a quarter of the picture or 16 px.
[[nodiscard]] std::array<double, 2> best_shift(const PyramidLevel& reference, const files::Picture& deformed);

/// Displacements of the nodes of one mesh from those of another, each in the pixels of its level; a node
/// outside takes the value of the nearest point of the other mesh's bounds.
void transfer(const ImageMesh& from, const Eigen::VectorXd& displacement, int from_level_number,
              const ImageMesh& to, int to_level_number, Eigen::VectorXd& out);

}  // namespace knothe::imaging
