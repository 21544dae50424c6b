#include "knothe/imaging/correlation/picture_pyramid.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"

namespace knothe::imaging {

namespace {

files::Picture halved(const files::Picture& picture, bool is_mask) {
  files::Picture half;
  half.width = picture.width / 2, half.height = picture.height / 2;
  half.bit_depth = picture.bit_depth, half.maximum = picture.maximum;
  half.pixels.resize(static_cast<std::size_t>(half.width) * half.height);
  for (int y = 0; y < half.height; ++y) {
    const float *upper = picture.row(2 * y), *lower = picture.row(2 * y + 1);
    for (int x = 0; x < half.width; ++x) {
      const float a = upper[2 * x], b = upper[2 * x + 1], c = lower[2 * x], d = lower[2 * x + 1];
      half.at(x, y) = is_mask ? std::min({a, b, c, d}) : 0.25F * (a + b + c + d);
    }
  }
  return half;
}

}  // namespace

std::vector<PyramidLevel> picture_pyramid(const files::Picture& picture, const files::Picture& mask,
                                          int top) {
  std::vector<PyramidLevel> levels(1);
  if (top == 0) levels.front() = {picture, mask};
  for (int level = 1; level <= top; ++level) {
    PyramidLevel coarser{halved(level == 1 ? picture : levels.back().picture, false), {}};
    if (!mask.pixels.empty()) coarser.mask = halved(level == 1 ? mask : levels.back().mask, true);
    levels.push_back(std::move(coarser));
  }
  return levels;
}

std::array<double, 2> best_shift(const PyramidLevel& reference, const files::Picture& deformed) {
  const files::Picture& f = reference.picture;
  struct Pixel {
    int x, y;
    double value;
  };
  std::vector<Pixel> pixels;
  double mean = 0;
  for (int y = 0; y < f.height; ++y)
    for (int x = 0; x < f.width; ++x)
      if (reference.mask.pixels.empty() || reference.mask.at(x, y) > 0)
        pixels.push_back({x, y, f.at(x, y)}), mean += pixels.back().value;
  if (pixels.empty()) return {0, 0};
  mean /= pixels.size();
  const int reach_x = std::min(16, f.width / 4), reach_y = std::min(16, f.height / 4);
  std::array<double, 2> best{0, 0};
  double highest = -2;
  for (int dy = -reach_y; dy <= reach_y; ++dy)
    for (int dx = -reach_x; dx <= reach_x; ++dx) {
      double product = 0, g_sum = 0, g_squares = 0, f_sum = 0, f_squares = 0, count = 0;
      for (const Pixel& p : pixels) {
        const int x = p.x + dx, y = p.y + dy;
        if (x < 0 || y < 0 || x >= deformed.width || y >= deformed.height) continue;
        const double g = deformed.at(x, y), v = p.value - mean;
        product += v * g, g_sum += g, g_squares += g * g, f_sum += v, f_squares += v * v, count += 1;
      }
      if (count < 0.5 * pixels.size()) continue;
      const double spread = (f_squares - f_sum * f_sum / count) * (g_squares - g_sum * g_sum / count);
      if (!(spread > 0)) continue;
      // Small shifts win where nothing tells them apart.
      const double correlation =
          (product - f_sum * g_sum / count) / std::sqrt(spread) - 1e-6 * std::hypot(dx, dy);
      if (correlation > highest)
        highest = correlation, best = {static_cast<double>(dx), static_cast<double>(dy)};
    }
  return best;
}

void transfer(const ImageMesh& from, const Eigen::VectorXd& displacement, int from_level_number,
              const ImageMesh& to, int to_level_number, Eigen::VectorXd& out) {
  const PointLocator locator(from);
  const Region bounds = from.bounds();
  const double scale = std::pow(2.0, from_level_number - to_level_number);
  out.setZero(2 * to.node_count());
  for (int a = 0; a < to.node_count(); ++a) {
    const std::size_t i = a;
    const double x = std::clamp(to_level(from_level(to.x[i], to_level_number), from_level_number), bounds.x0,
                                bounds.x1),
                 y = std::clamp(to_level(from_level(to.y[i], to_level_number), from_level_number), bounds.y0,
                                bounds.y1);
    const auto place = locator.find(x, y);
    if (place.element < 0) continue;
    const auto& nodes = from.elements[place.element];
    for (Index n = 0; n < ImageMesh::nodes_of(nodes); ++n)
      for (int k = 0; k < 2; ++k) out[2 * a + k] += scale * place.shape[n] * displacement[2 * nodes[n] + k];
  }
}

}  // namespace knothe::imaging
