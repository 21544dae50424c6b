#include "knothe/imaging/stereo/drawn_view.hpp"

#include <fmt/format.h>

#include <Eigen/LU>

#include "knothe/base/error.hpp"

namespace knothe::imaging {
namespace {

/// (s, t) with P(X(s, t)) = pixel, from a place nearby. The derivative of X is that of differences over a px.
Eigen::Vector2d seen_point(const Camera& camera, const SurfacePlace& surface, const Eigen::Vector2d& pixel,
                           Eigen::Vector2d at) {
  for (int k = 0; k < 60; ++k) {
    const Projection p = camera.project(surface(at.x(), at.y()));
    Eigen::Matrix<double, 3, 2> slope;
    slope << surface(at.x() + 0.5, at.y()) - surface(at.x() - 0.5, at.y()),
        surface(at.x(), at.y() + 0.5) - surface(at.x(), at.y() - 0.5);
    const Eigen::Vector2d step = (p.jacobian * slope).inverse() * (pixel - p.pixel);
    at += step;
    if (!at.allFinite()) break;
    if (step.norm() < 1e-9) return at;
  }
  throw UsageError(fmt::format("pixel ({}, {}) does not see the surface: bring it into the camera's view",
                               pixel.x(), pixel.y()));
}

}  // namespace

files::Picture drawn_view(const Camera& camera, int width, int height, const SpecklePattern& pattern,
                          const SurfacePlace& surface, int supersampling) {
  files::Picture picture{width, height, 8, 255, {}, {}};
  Eigen::Vector2d row_start(pattern.options().width / 2.0, pattern.options().height / 2.0);
  for (int y = 0; y < height; ++y) {
    Eigen::Vector2d at = row_start;
    for (int x = 0; x < width; ++x) {
      double sum = 0;
      for (int k = 0; k < supersampling * supersampling; ++k) {
        const double dx = (k % supersampling + 0.5) / supersampling - 0.5,
                     dy = (k / supersampling + 0.5) / supersampling - 0.5;
        at = seen_point(camera, surface, {x + dx, y + dy}, at);
        sum += pattern.at(at.x(), at.y());
      }
      if (x == 0) row_start = at;
      picture.pixels.push_back(255 * sum / (supersampling * supersampling));
    }
  }
  return picture;
}

}  // namespace knothe::imaging
