#include "knothe/imaging/series/speckle.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/base/threads.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_reach = 4.5;  // of a dot, in its standard deviations

/// A number in [0, 1) from a counter: splitmix64, so that rows can be drawn in any order.
double uniform(std::uint64_t seed, std::uint64_t counter) {
  std::uint64_t z = seed * 0x9E3779B97F4A7C15ULL + (counter + 1) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  z ^= z >> 31;
  return ((z >> 11) + 0.5) * 0x1p-53;
}

/// A standard normal number from a counter, by Box and Muller.
double normal(std::uint64_t seed, std::uint64_t counter) {
  return std::sqrt(-2 * std::log(uniform(seed, 2 * counter))) *
         std::cos(2 * std::numbers::pi * uniform(seed, 2 * counter + 1));
}

/// X with X + u(X) = x; false where Newton's method finds none.
bool material_point(const DisplacementField& displacement, double x, double y, double& at_x, double& at_y) {
  for (int k = 0; k < 50; ++k) {
    const Displacement d = displacement(at_x, at_y);
    if (!std::isfinite(d.u) || !std::isfinite(d.v))
      throw UsageError(
          fmt::format("speckle picture: the displacement at ({}, {}) px is not finite", at_x, at_y));
    const double rx = at_x + d.u - x, ry = at_y + d.v - y;
    const double a = 1 + d.gradient[0], b = d.gradient[1], c = d.gradient[2], e = 1 + d.gradient[3],
                 det = a * e - b * c;
    if (!(std::abs(det) > 1e-6)) return false;
    const double sx = (e * rx - b * ry) / det, sy = (a * ry - c * rx) / det;
    at_x -= sx, at_y -= sy;
    if (std::abs(sx) + std::abs(sy) < 1e-10) return true;
  }
  return false;
}

}  // namespace

float recorded_level(const SpeckleCamera& camera, double light, std::uint64_t counter) {
  const int maximum = (1 << camera.bit_depth) - 1;
  double level = camera.gain * 255 * light + camera.offset;
  if (camera.noise > 0) level += camera.noise * normal(camera.seed, counter);
  level *= maximum / 255.0;
  if (camera.dead_pixels > 0 && uniform(camera.seed ^ 0x64656164, counter) < camera.dead_pixels) level = 0;
  if (camera.quantise) level = std::clamp<double>(std::round(level), 0.0, maximum);
  return level;
}

SpecklePattern::SpecklePattern(SpeckleOptions options) : options_(options) {
  if (options.width < 4 || options.height < 4 || !(options.dot_radius > 0) || !(options.coverage > 0) ||
      !(options.margin >= 0))
    throw UsageError(fmt::format(
        "speckle pattern of {} × {} px with dots of {} px, coverage {}, margin {} px: sizes must be positive",
        options.width, options.height, options.dot_radius, options.coverage, options.margin));
  const double width = options.width + 2 * options.margin, height = options.height + 2 * options.margin;
  columns_ = static_cast<int>(width / cell_) + 1;
  rows_ = static_cast<int>(height / cell_) + 1;
  cells_.resize(static_cast<std::size_t>(columns_) * rows_);
  const double area = 2 * std::numbers::pi * options.dot_radius * options.dot_radius;
  const auto count = static_cast<std::uint64_t>(options.coverage * width * height / area);
  for (std::uint64_t k = 0; k < count; ++k) {
    const auto draw = [&](std::uint64_t i) { return uniform(options.seed, 4 * k + i); };
    const double s = options.dot_radius * (0.7 + 0.6 * draw(2));
    const Dot dot{static_cast<float>(draw(0) * width), static_cast<float>(draw(1) * height),
                  static_cast<float>(1 / (2 * s * s)), static_cast<float>(draw(3) < 0.5 ? -0.42 : 0.42)};
    const auto cell = [&](double at, int last) { return std::clamp<int>(std::floor(at / cell_), 0, last); };
    for (int j = cell(dot.y - k_reach * s, rows_ - 1); j <= cell(dot.y + k_reach * s, rows_ - 1); ++j)
      for (int i = cell(dot.x - k_reach * s, columns_ - 1); i <= cell(dot.x + k_reach * s, columns_ - 1); ++i)
        cells_[j * columns_ + i].push_back(dot);
  }
}

double SpecklePattern::at(double x, double y) const {
  const double px = x + options_.margin, py = y + options_.margin;
  const int i = std::clamp<int>(px / cell_, 0, columns_ - 1), j = std::clamp<int>(py / cell_, 0, rows_ - 1);
  double sum = 0;
  for (const Dot& dot : cells_[j * columns_ + i]) {
    const double dx = px - dot.x, dy = py - dot.y, q = (dx * dx + dy * dy) * dot.inverse_two_variance;
    // The tail is brought to zero smoothly, so that a dot has no edge where its cell ends.
    if (q < 0.5 * k_reach * k_reach)
      sum += dot.amplitude * (std::exp(-q) - std::exp(-0.5 * k_reach * k_reach));
  }
  return 0.5 + 0.42 * std::tanh(sum);  // smooth, and never saturated
}

double SpecklePattern::at(double x, double y, const BodyShape& body) const {
  const double share = body ? body(x, y) : 1;
  return (share > 0 ? share * at(x, y) : 0) + (1 - share) * k_background;
}

files::Picture SpecklePattern::render(const DisplacementField& displacement, const SpeckleCamera& camera,
                                      int threads, const BodyShape& body) const {
  files::Picture picture;
  picture.width = options_.width, picture.height = options_.height, picture.bit_depth = camera.bit_depth;
  picture.maximum = (1 << camera.bit_depth) - 1;
  picture.pixels.resize(static_cast<std::size_t>(options_.width) * options_.height);
  const int n = std::max(1, camera.supersampling);
  parallel_for(options_.height, threads, [&](std::size_t row) {
    const int y = row;
    double last_x = 0, last_y = 0;  // displacement of the last point: where to begin
    for (int x = 0; x < options_.width; ++x) {
      double sum = 0;
      for (int a = 0; a < n; ++a)
        for (int b = 0; b < n; ++b) {
          const double sx = x + (a + 0.5) / n - 0.5, sy = y + (b + 0.5) / n - 0.5;
          double at_x = sx - last_x, at_y = sy - last_y;
          if (displacement) {
            if (!material_point(displacement, sx, sy, at_x, at_y)) continue;
            last_x = sx - at_x, last_y = sy - at_y;
          }
          sum += at(at_x, at_y, body);
        }
      const std::uint64_t counter = picture.index(x, y);
      picture.pixels[counter] = recorded_level(camera, sum / (n * n), counter);
    }
  });
  return picture;
}

}  // namespace knothe::imaging
