#include "knothe/imaging/stereo/drawn_view.hpp"

#include <fmt/format.h>

#include <Eigen/LU>

#include "knothe/base/error.hpp"
#include "knothe/base/threads.hpp"

namespace knothe::imaging {
namespace {

/// (s, t) with P(X(s, t)) = pixel, from a place nearby; false where Newton's method finds none. The
/// derivative of X is that of differences over a px, taken again where it does not lead on.
bool seen_point(const Camera& camera, const SurfacePlace& surface, const Eigen::Vector2d& pixel,
                Eigen::Vector2d& at) {
  Eigen::Matrix2d inverse;
  double last = 0;
  for (int k = 0; k < 60; ++k) {
    const Projection p = camera.project(surface(at.x(), at.y()));
    const Eigen::Vector2d miss = pixel - p.pixel;
    if (!(miss.norm() < 0.1 * last)) {
      Eigen::Matrix<double, 3, 2> slope;
      slope << surface(at.x() + 0.5, at.y()) - surface(at.x() - 0.5, at.y()),
          surface(at.x(), at.y() + 0.5) - surface(at.x(), at.y() - 0.5);
      inverse = (p.jacobian * slope).inverse();
    }
    last = miss.norm();
    const Eigen::Vector2d step = inverse * miss;
    at += step;
    if (!at.allFinite()) return false;
    if (step.norm() < 1e-9) return true;
  }
  return false;
}

}  // namespace

files::Picture drawn_view(const Camera& camera, int width, int height, const SpecklePattern& pattern,
                          const SurfacePlace& surface, const SpeckleCamera& taken, int threads,
                          const BodyShape& body) {
  files::Picture picture;
  picture.width = width, picture.height = height, picture.bit_depth = taken.bit_depth;
  picture.maximum = (1 << taken.bit_depth) - 1;
  picture.pixels.resize(std::size_t(width) * height);
  const int n = taken.supersampling;
  const Eigen::Vector2d middle(pattern.options().width / 2.0, pattern.options().height / 2.0);
  parallel_for(height, threads, [&](std::size_t row) {
    const int y = row;
    Eigen::Vector2d start = middle;
    for (int x = 0; x < width; ++x) {
      double sum = 0;
      for (int k = 0; k < n * n; ++k) {
        const double dx = (k % n + 0.5) / n - 0.5, dy = (k / n + 0.5) / n - 0.5;
        Eigen::Vector2d at = start;
        const bool found = seen_point(camera, surface, {x + dx, y + dy}, at);
        if (!found && !body)
          throw UsageError(
              fmt::format("pixel ({}, {}) does not see the surface: bring it into the camera's view", x, y));
        sum += found ? pattern.at(at.x(), at.y(), body) : k_background;
        start = found ? at : middle;
      }
      const std::uint64_t counter = picture.index(x, y);
      picture.pixels[counter] = recorded_level(taken, sum / (n * n), counter);
    }
  });
  return picture;
}

}  // namespace knothe::imaging
